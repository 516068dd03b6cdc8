// SPDX-FileCopyrightText: 2026 The terrain_estimator authors
// SPDX-License-Identifier: Apache-2.0
//
// Products and triangular factors of small matrices, several numbers at once.
//
// What is computed at once are different results. Each result is summed in the order in which one
// would sum it alone, so the bytes do not depend on how wide a processor's registers are.

#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "elementary.hpp"

namespace terrain::detail {

// As many numbers as a register holds, anywhere in memory (a vector of GCC and clang).
#ifdef __AVX__
constexpr int64_t kLanes = 4;
#else
constexpr int64_t kLanes = 2;
#endif
typedef double Lanes __attribute__((vector_size(8 * kLanes), aligned(8), may_alias));

TERRAIN_INLINE Lanes& lanes(double* at) { return *reinterpret_cast<Lanes*>(at); }
TERRAIN_INLINE const Lanes& lanes(const double* at) { return *reinterpret_cast<const Lanes*>(at); }

// c[R, P lanes] = a[R, k] b[k, P lanes]; a by strides, b and c by rows
template <int R, int P>
TERRAIN_INLINE void product(const double* a, int64_t am, int64_t ak, const double* b, int64_t bk,
                            double* c, int64_t cm, int64_t k) {
  Lanes sum[R * P] = {};
  for (int64_t l = 0; l < k; ++l)
#pragma GCC unroll 8
    for (int t = 0; t < R * P; ++t)
      sum[t] += a[t / P * am + l * ak] * lanes(b + l * bk + t % P * kLanes);
#pragma GCC unroll 8
  for (int t = 0; t < R * P; ++t) lanes(c + t / P * cm + t % P * kLanes) = sum[t];
}

// The same for R rows of c and all its n columns, of which the last lanes may compute some again.
template <int R>
inline void rows(const double* a, int64_t am, int64_t ak, const double* b, int64_t bk, double* c,
                 int64_t k, int64_t n) {
  constexpr int kWide = R == 1 ? 4 : 2;  // enough sums to hide the time that one takes
  int64_t j = 0;
  for (; j + kWide * kLanes <= n; j += kWide * kLanes)
    product<R, kWide>(a, am, ak, b + j, bk, c + j, n, k);
  for (; j < n; j += kLanes) {
    const int64_t at = std::min(j, n - kLanes);
    product<R, 1>(a, am, ak, b + at, bk, c + at, n, k);
  }
}

// The same for fewer columns than lanes.
template <int R>
inline void narrow_rows(const double* a, int64_t am, int64_t ak, const double* b, int64_t bk,
                        double* c, int64_t k, int64_t n) {
  for (int64_t j = 0; j < n; ++j) {
    double sum[R] = {};
    for (int64_t l = 0; l < k; ++l)
      for (int r = 0; r < R; ++r) sum[r] += a[r * am + l * ak] * b[l * bk + j];
    for (int r = 0; r < R; ++r) c[r * n + j] = sum[r];
  }
}

// c [m, n] = a [m, k] b [k, n], a by strides, b and c by rows
__attribute__((noinline)) inline void multiply(const double* a, int64_t am, int64_t ak,
                                               const double* b, int64_t bk, double* c, int64_t m,
                                               int64_t k, int64_t n) {
  int64_t i = 0;
  if (n < kLanes) {
    for (; i + 4 <= m; i += 4) narrow_rows<4>(a + i * am, am, ak, b, bk, c + i * n, k, n);
    for (; i < m; ++i) narrow_rows<1>(a + i * am, am, ak, b, bk, c + i * n, k, n);
    return;
  }
  for (; i + 4 <= m; i += 4) rows<4>(a + i * am, am, ak, b, bk, c + i * n, k, n);
  for (; i + 2 <= m; i += 2) rows<2>(a + i * am, am, ak, b, bk, c + i * n, k, n);
  if (i < m) rows<1>(a + i * am, am, ak, b, bk, c + i * n, k, n);
}

// L of A = L L' in place, of kLanes systems [n, n] side by side; false where one is not positive.
inline bool factorise(Lanes* l, int64_t n) {
  for (int64_t j = 0; j < n; ++j) {
    Lanes d = l[j * n + j];
    for (int64_t k = 0; k < j; ++k) d -= l[j * n + k] * l[j * n + k];
    for (int t = 0; t < kLanes; ++t)
      if (!(d[t] > 0.0)) return false;
    for (int t = 0; t < kLanes; ++t) d[t] = std::sqrt(d[t]);
    l[j * n + j] = d;
    for (int64_t i = j + 1; i < n; ++i) {
      Lanes s = l[i * n + j];
      for (int64_t k = 0; k < j; ++k) s -= l[i * n + k] * l[j * n + k];
      l[i * n + j] = s / d;
    }
  }
  return true;
}

// The same of one system, up to the first minor that is not positive; returns its order or 0.
inline int64_t factorise(double* l, int64_t n) {
  for (int64_t j = 0; j < n; ++j) {
    double d = l[j * n + j];
    for (int64_t k = 0; k < j; ++k) d -= l[j * n + k] * l[j * n + k];
    if (!(d > 0.0)) return j + 1;
    d = std::sqrt(d);
    l[j * n + j] = d;
    for (int64_t i = j + 1; i < n; ++i) {
      double s = l[i * n + j];
      for (int64_t k = 0; k < j; ++k) s -= l[i * n + k] * l[j * n + k];
      l[i * n + j] = s / d;
    }
  }
  return 0;
}

// X of L X = B in place [n, m], of kLanes systems side by side
inline void forward(const Lanes* l, Lanes* x, int64_t n, int64_t m) {
  for (int64_t i = 0; i < n; ++i)
    for (int64_t c = 0; c < m; ++c) {
      Lanes s = x[i * m + c];
      for (int64_t k = 0; k < i; ++k) s -= l[i * n + k] * x[k * m + c];
      x[i * m + c] = s / l[i * n + i];
    }
}

// X of L' X = B in place [n, m]
inline void backward(const Lanes* l, Lanes* x, int64_t n, int64_t m) {
  for (int64_t i = n - 1; i >= 0; --i)
    for (int64_t c = 0; c < m; ++c) {
      Lanes s = x[i * m + c];
      for (int64_t k = i + 1; k < n; ++k) s -= l[k * n + i] * x[k * m + c];
      x[i * m + c] = s / l[i * n + i];
    }
}

// Lays up to kLanes matrices of `count` numbers side by side, the last one as often as needed.
inline void gather(Lanes* to, const double* from, int64_t step, int64_t number, int64_t count) {
  const double* each[kLanes];
  for (int64_t t = 0; t < kLanes; ++t) each[t] = from + std::min(t, number - 1) * step;
  for (int64_t i = 0; i < count; ++i)
    for (int64_t t = 0; t < kLanes; ++t) to[i][t] = each[t][i];
}
inline void scatter(double* to, const Lanes* from, int64_t step, int64_t number, int64_t count) {
  for (int64_t t = 0; t < std::min(number, kLanes); ++t)
    for (int64_t i = 0; i < count; ++i) to[t * step + i] = from[i][t];
}

}  // namespace terrain::detail
