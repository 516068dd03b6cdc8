// SPDX-FileCopyrightText: 2026 The terrain_estimator authors
// SPDX-License-Identifier: Apache-2.0
//
// The C functions of a compiled model. Included at the end of its source, which has the model's
// functions, `kModel` (hash of the TorchScript file) and `kNames` (of the state's tensors).
//
// A function that fails returns null or -1, and terrain_error() says why. Nothing is thrown across
// the border. One thread at a time.

#include <cstdio>

#include "terrain_core.h"

#define TERRAIN_API extern "C" __attribute__((visibility("default")))

struct TerrainState {
  terrain::Dictionary<terrain::Tensor> tensors;
};
using State = TerrainState;

namespace terrain {
namespace {

char last_error[256] = "";

template <class Result, class F>
Result guarded(Result failed, F f) {
  try {
    return f();
  } catch (const std::exception& error) {
    std::snprintf(last_error, sizeof last_error, "%s", error.what());
    return failed;
  }
}

int64_t write(const Tensor& x, double* out, int64_t room) {
  const Tensor values = contiguous(x);
  require(values.count() <= room, "there is no room for the result");
  std::copy(values.data(), values.data() + values.count(), out);
  return values.count();
}

Tensor vector(const double* values, int64_t count) {
  return Tensor::of(values, {count}, Kind::kReal);
}

}  // namespace
}  // namespace terrain

// Of this interface; a caller refuses another one.
TERRAIN_API int64_t terrain_version() { return 1; }
TERRAIN_API const char* terrain_model() { return terrain::model::kModel; }
TERRAIN_API const char* terrain_error() { return terrain::last_error; }

// The names of the state's tensors, in the order of their keys; null behind the last.
TERRAIN_API const char* terrain_name(int64_t key) {
  constexpr int64_t count = sizeof(terrain::model::kNames) / sizeof(terrain::model::kNames[0]);
  return key >= 0 && key < count ? terrain::model::kNames[key] : nullptr;
}

TERRAIN_API void terrain_free(State* state) { delete state; }

TERRAIN_API State* terrain_initial() {
  return terrain::guarded<State*>(nullptr, [] { return new State{terrain::model::initial()}; });
}

TERRAIN_API State* terrain_initial_with_prior(const double* mean, const double* sd,
                                              const double* soils, int64_t count, double drift) {
  using namespace terrain;
  return guarded<State*>(nullptr, [=] {
    return new State{
        model::initial_with_prior(terrain::vector(mean, 2), terrain::vector(sd, 2), terrain::vector(soils, count), drift)};
  });
}

// The state after a packed observation; the one given stays as it is.
TERRAIN_API State* terrain_update(const State* state, const double* packed, int64_t count) {
  using namespace terrain;
  return guarded<State*>(nullptr, [=] {
    return new State{model::update(state->tensors, terrain::vector(packed, count))};
  });
}

TERRAIN_API State* terrain_discard(const State* state) {
  using namespace terrain;
  return guarded<State*>(nullptr, [=] { return new State{model::discard(state->tensors)}; });
}

TERRAIN_API int64_t terrain_predict(const State* state, const double* packed, int64_t count,
                                    double* out) {
  using namespace terrain;
  return guarded<int64_t>(
      -1, [=] { return write(model::predict(state->tensors, terrain::vector(packed, count)), out, 2); });
}

TERRAIN_API int64_t terrain_estimate(const State* state, double* out) {
  using namespace terrain;
  return guarded<int64_t>(-1, [=] { return write(model::estimate(state->tensors), out, 6); });
}

TERRAIN_API int64_t terrain_effects(const State* state, double* out, int64_t room) {
  using namespace terrain;
  return guarded<int64_t>(-1, [=] { return write(model::effects(state->tensors), out, room); });
}

// The numbers of some tensors of the state one behind the other; returns how many.
TERRAIN_API int64_t terrain_read(const State* state, const int64_t* keys, int64_t count,
                                 double* out, int64_t room) {
  using namespace terrain;
  return guarded<int64_t>(-1, [=] {
    int64_t at = 0;
    for (int64_t k = 0; k < count; ++k)
      at += write(state->tensors[keys[k]], out + at, room - at);
    return at;
  });
}

// Sizes and kind (0 truth value, 1 integer, 2 single, 3 double) of a tensor; returns how many
// dimensions.
TERRAIN_API int64_t terrain_shape(const State* state, int64_t key, int64_t* sizes, int64_t* kind) {
  using namespace terrain;
  return guarded<int64_t>(-1, [=] {
    const Tensor x = state->tensors[key];
    for (int d = 0; d < x.dimensions(); ++d) sizes[d] = x.size(d);
    *kind = static_cast<int64_t>(x.kind());
    return int64_t{x.dimensions()};
  });
}

// A state without tensors, and one tensor more in a state.
TERRAIN_API State* terrain_empty() { return new State; }
TERRAIN_API int64_t terrain_put(State* state, int64_t key, const double* values,
                                const int64_t* sizes, int64_t dimensions, int64_t kind) {
  using namespace terrain;
  return guarded<int64_t>(-1, [=] {
    Integers all;
    for (int64_t d = 0; d < dimensions; ++d) all.append(sizes[d]);
    Tensor x = Tensor::empty(all, static_cast<Kind>(kind));
    std::copy(values, values + x.count(), x.data());
    state->tensors.set(key, x);
    return int64_t{0};
  });
}

// The state with another bank, given as the tensors mean, covariance, precision, weight, age, kind.
TERRAIN_API State* terrain_publish(const State* state, const State* bank, const int64_t* keys) {
  using namespace terrain;
  return guarded<State*>(nullptr, [=] {
    const auto& b = bank->tensors;
    return new State{model::publish(state->tensors, {b[keys[0]], b[keys[1]], b[keys[2]], b[keys[3]],
                                              b[keys[4]], b[keys[5]]})};
  });
}

// The drive that was recorded with the model: packed observations, one behind the other.
TERRAIN_API const double* terrain_drive(int64_t* observations, int64_t* size) {
  *observations = sizeof(terrain::model::kAnswers) / sizeof(terrain::model::kAnswers[0]);
  *size = sizeof(terrain::model::kDrive) / sizeof(double) / *observations;
  return terrain::model::kDrive;
}

// Runs the drive that was recorded with the model, and returns the largest difference to what
// TorchScript answered: of c and tan phi in their deviations, of the velocity ahead in its own.
// Infinite where one has an answer and the other has none.
TERRAIN_API double terrain_check() {
  using namespace terrain;
  return guarded<double>(elementary::kInfinity, [] {
    constexpr int64_t observations = sizeof(model::kAnswers) / sizeof(model::kAnswers[0]);
    constexpr int64_t size = sizeof(model::kDrive) / sizeof(double) / observations;
    Dictionary<Tensor> state = model::initial();
    double worst = 0.0;
    const auto compare = [&worst](double mean, double variance, double known, double of_known) {
      if (known != known && mean != mean) return;
      const double off = std::fabs(mean - known) / std::sqrt(of_known);
      const double wider = std::fabs(variance / of_known - 1.0);
      const bool sound = off < elementary::kInfinity && wider < elementary::kInfinity;
      worst = std::max(worst, sound ? std::max(off, wider) : elementary::kInfinity);
    };
    for (int64_t k = 0; k < observations; ++k) {
      state = model::update(state, terrain::vector(model::kDrive + k * size, size));
      const double* known = model::kAnswers[k];
      const Tensor mean = contiguous(state[model::key::strength_mean]);
      const Tensor covariance = contiguous(state[model::key::strength_covariance]);
      compare(mean.data()[0], covariance.data()[0], known[0], known[2]);
      compare(mean.data()[1], covariance.data()[3], known[1], known[3]);
      compare(state[model::key::forecast].item(), state[model::key::forecast_variance].item(),
              known[4], known[5]);
    }
    return worst;
  });
}

// Runs `count` packed observations of `size` numbers; after each, the numbers of some tensors go
// into a row of `out` [count, width]. Returns the state after the last.
TERRAIN_API State* terrain_run(const State* state, const double* packed, int64_t count,
                               int64_t size, const int64_t* keys, int64_t number, double* out,
                               int64_t width) {
  using namespace terrain;
  return guarded<State*>(nullptr, [=] {
    Dictionary<Tensor> now = state->tensors;
    for (int64_t k = 0; k < count; ++k) {
      now = model::update(now, terrain::vector(packed + k * size, size));
      int64_t at = 0;
      for (int64_t n = 0; n < number; ++n)
        at += write(now[keys[n]], out + k * width + at, width - at);
    }
    return new State{now};
  });
}
