/* SPDX-FileCopyrightText: 2026 The terrain_estimator authors
 * SPDX-License-Identifier: Apache-2.0
 *
 * The C interface of a compiled model; interface.hpp says what each function does. A function that
 * fails returns null or -1, and terrain_error() says why. One thread at a time. */

#ifndef TERRAIN_CORE_H
#define TERRAIN_CORE_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef struct TerrainState TerrainState;

int64_t terrain_version(void);
const char* terrain_model(void);
const char* terrain_error(void);
const char* terrain_name(int64_t key);
const double* terrain_drive(int64_t* observations, int64_t* size);
double terrain_check(void);
TerrainState* terrain_initial(void);
TerrainState* terrain_initial_with_prior(const double* mean, const double* sd, const double* soils,
                                         int64_t count, double drift);
TerrainState* terrain_update(const TerrainState* state, const double* packed, int64_t count);
TerrainState* terrain_discard(const TerrainState* state);
void terrain_free(TerrainState* state);
int64_t terrain_predict(const TerrainState* state, const double* packed, int64_t count, double* out);
int64_t terrain_estimate(const TerrainState* state, double* out);
int64_t terrain_effects(const TerrainState* state, double* out, int64_t room);
int64_t terrain_read(const TerrainState* state, const int64_t* keys, int64_t count, double* out,
                     int64_t room);

#ifdef __cplusplus
}
#endif

#endif /* TERRAIN_CORE_H */
