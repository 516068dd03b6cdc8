/* SPDX-FileCopyrightText: 2026 The terrain_estimator authors
 * SPDX-License-Identifier: Apache-2.0
 *
 * The C interface of a compiled model. README.md beside this file has the layout of `packed`, the
 * numbers of one observation.
 *
 * A function that fails returns null or -1, and terrain_error() says why. No function changes a
 * state that it is given, but terrain_put(). Free every state with terrain_free(). One thread at a
 * time. All numbers are doubles in SI units. */

#ifndef TERRAIN_CORE_H
#define TERRAIN_CORE_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef struct TerrainState TerrainState;

/* About the model */

/* Version of this interface. */
int64_t terrain_version(void);
/* SHA-256 of the TorchScript file that the model was made from. */
const char* terrain_model(void);
/* Why the last call failed; it stays until another one fails. */
const char* terrain_error(void);
/* Name of the state's tensor with this key; null behind the last. Keys count from 0. */
const char* terrain_name(int64_t key);

/* Estimating */

/* The state before the first observation, with the model's own prior and no drift. */
TerrainState* terrain_initial(void);
/* The same with a prior of one's own: mean[2] and sd[2] of c [Pa] and tan phi [1], the probability
 * soils[count] of each soil, and drift [1/sqrt(s)], the random walk of c and tan phi in prior
 * deviations; 0 for ground that stays. */
TerrainState* terrain_initial_with_prior(const double* mean, const double* sd, const double* soils,
                                         int64_t count, double drift);
/* The state after an observation packed[count]. */
TerrainState* terrain_update(const TerrainState* state, const double* packed, int64_t count);
/* The state after `count` observations packed[count][size]. After each of them, the numbers of the
 * tensors keys[number] are written into a row of out[count][width], one tensor after the other;
 * what a row has beyond them stays as it was. `number` may be 0. */
TerrainState* terrain_run(const TerrainState* state, const double* packed, int64_t count,
                          int64_t size, const int64_t* keys, int64_t number, double* out,
                          int64_t width);
/* The state without the observations that wait in the open block, with an unknown velocity. */
TerrainState* terrain_discard(const TerrainState* state);
void terrain_free(TerrainState* state);

/* Results. They return how many numbers they write. */

/* out[2]: mean [m/s] and variance of the velocity that an observation measures. */
int64_t terrain_predict(const TerrainState* state, const double* packed, int64_t count, double* out);
/* out[3][2]: mean of c [Pa] and tan phi, then the rows of their covariance. */
int64_t terrain_estimate(const TerrainState* state, double* out);
/* out[J][2]: mean and variance of the size of each of J named effects; J may be 0. */
int64_t terrain_effects(const TerrainState* state, double* out, int64_t room);
/* The numbers of the tensors keys[count], one tensor after the other, each row by row. */
int64_t terrain_read(const TerrainState* state, const int64_t* keys, int64_t count, double* out,
                     int64_t room);

/* Saving and restoring a state: read every tensor that it has, and put them into an empty one. */

/* Number of dimensions of a tensor, -1 where the state has none of this key. sizes[8] takes the
 * sizes; kind takes 0 for truth values, 1 for integers, 2 for singles, 3 for doubles. */
int64_t terrain_shape(const TerrainState* state, int64_t key, int64_t* sizes, int64_t* kind);
/* A state without tensors. */
TerrainState* terrain_empty(void);
/* Puts a tensor into a state, in place of one with this key; values as terrain_read() gives them.
 * Returns 0. */
int64_t terrain_put(TerrainState* state, int64_t key, const double* values, const int64_t* sizes,
                    int64_t dimensions, int64_t kind);
/* The state with another bank of hypotheses and all that follows from it: `bank` has the tensors
 * keys[6] of mean, covariance, precision, weight, age and kind. What a saved state holds needs no
 * such call. */
TerrainState* terrain_publish(const TerrainState* state, const TerrainState* bank,
                              const int64_t* keys);

/* Checking */

/* The recorded drive, packed[observations][size]. */
const double* terrain_drive(int64_t* observations, int64_t* size);
/* Largest difference to what TorchScript answered to that drive, in posterior deviations; infinite
 * where one of them gives no answer. A sound core stays below 1e-9. */
double terrain_check(void);

#ifdef __cplusplus
}
#endif

#endif /* TERRAIN_CORE_H */
