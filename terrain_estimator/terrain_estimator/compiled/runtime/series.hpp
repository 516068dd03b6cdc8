// SPDX-FileCopyrightText: 2026 The terrain_estimator authors
// SPDX-License-Identifier: Apache-2.0
//
// Elementary functions of many numbers, to[i] = f(x[i]): one loop each, so that a register is full
// and few of the steps wait for the one before. `to` may be `x`.
//
// A cheaper form is taken where all numbers are within a range in which it gives the same bytes.

#pragma once

#include "elementary.hpp"

namespace terrain::series {

constexpr double kLeastNormal = std::numeric_limits<double>::min();
constexpr double kMostFinite = std::numeric_limits<double>::max();

// NaN is within no range.
inline bool within(const double* x, int64_t count, double low, double high) {
  using elementary::bits;  // of doubles: SSE2 chooses between them, not between integers
  uint64_t outside = 0;
  for (int64_t i = 0; i < count; ++i)
    outside |= bits(x[i] >= low ? 0.0 : 1.0) | bits(x[i] <= high ? 0.0 : 1.0);
  return outside == 0;
}

template <class F>
TERRAIN_INLINE void each(const double* x, double* to, int64_t count, F f) {
#pragma GCC ivdep
  for (int64_t i = 0; i < count; ++i) to[i] = f(x[i]);
}

#define TERRAIN_PLAIN(name)                                               \
  inline void name(const double* x, double* to, int64_t count) {          \
    each(x, to, count, [](double v) TERRAIN_INNER { return elementary::name(v); }); \
  }
TERRAIN_PLAIN(asin)
TERRAIN_PLAIN(tanh)
#undef TERRAIN_PLAIN

#define TERRAIN_CHEAPER(name, low, high, near)                            \
  inline void name(const double* x, double* to, int64_t count) {          \
    if (within(x, count, low, high))                                      \
      each(x, to, count, [](double v) TERRAIN_INNER { return elementary::near(v); }); \
    else                                                                  \
      each(x, to, count, [](double v) TERRAIN_INNER { return elementary::name(v); }); \
  }
TERRAIN_CHEAPER(sin, -0.78, 0.78, sin_near_zero)  // below pi / 4 no quarter is turned
TERRAIN_CHEAPER(cos, -0.78, 0.78, cos_near_zero)
TERRAIN_CHEAPER(exp, -700.0, 700.0, exp_of_moderate)
TERRAIN_CHEAPER(expm1, -60.0, 700.0, expm1_of_moderate)
TERRAIN_CHEAPER(log, kLeastNormal, kMostFinite, log_of_normal)
#undef TERRAIN_CHEAPER

// to[i] = x[i] to the power y[i]; positive numbers need no sign and take two shorter loops.
inline void pow(const double* x, const double* y, double* to, int64_t count) {
  if (within(x, count, kLeastNormal, kMostFinite)) {
#pragma GCC ivdep
    for (int64_t i = 0; i < count; ++i) to[i] = y[i] * elementary::log_of_normal(x[i]);
    exp(to, to, count);
  } else {
#pragma GCC ivdep
    for (int64_t i = 0; i < count; ++i) to[i] = elementary::pow(x[i], y[i]);
  }
}

}  // namespace terrain::series
