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
#if defined(__AVX512F__)
constexpr int64_t kLanes = 8;
#elif defined(__AVX__)
constexpr int64_t kLanes = 4;
#else
constexpr int64_t kLanes = 2;
#endif
typedef double Lanes __attribute__((vector_size(8 * kLanes), aligned(8), may_alias));

TERRAIN_INLINE Lanes& lanes(double* at) { return *reinterpret_cast<Lanes*>(at); }
TERRAIN_INLINE const Lanes& lanes(const double* at) { return *reinterpret_cast<const Lanes*>(at); }

// Rows become columns.
TERRAIN_INLINE void transpose(Lanes (&x)[kLanes]) {
#if defined(__AVX512F__)
  for (int i = 0; i < 8; i += 2) {
    const Lanes a = x[i], b = x[i + 1];
    x[i] = Lanes{a[0], b[0], a[2], b[2], a[4], b[4], a[6], b[6]};
    x[i + 1] = Lanes{a[1], b[1], a[3], b[3], a[5], b[5], a[7], b[7]};
  }
  for (int i : {0, 1, 4, 5}) {
    const Lanes a = x[i], b = x[i + 2];
    x[i] = Lanes{a[0], a[1], b[0], b[1], a[4], a[5], b[4], b[5]};
    x[i + 2] = Lanes{a[2], a[3], b[2], b[3], a[6], a[7], b[6], b[7]};
  }
  for (int i = 0; i < 4; ++i) {
    const Lanes a = x[i], b = x[i + 4];
    x[i] = Lanes{a[0], a[1], a[2], a[3], b[0], b[1], b[2], b[3]};
    x[i + 4] = Lanes{a[4], a[5], a[6], a[7], b[4], b[5], b[6], b[7]};
  }
#elif defined(__AVX__)
  const Lanes a{x[0][0], x[1][0], x[0][2], x[1][2]}, b{x[0][1], x[1][1], x[0][3], x[1][3]};
  const Lanes c{x[2][0], x[3][0], x[2][2], x[3][2]}, d{x[2][1], x[3][1], x[2][3], x[3][3]};
  x[0] = Lanes{a[0], a[1], c[0], c[1]};
  x[1] = Lanes{b[0], b[1], d[0], d[1]};
  x[2] = Lanes{a[2], a[3], c[2], c[3]};
  x[3] = Lanes{b[2], b[3], d[2], d[3]};
#else
  const Lanes a{x[0][0], x[1][0]}, b{x[0][1], x[1][1]};
  x[0] = a;
  x[1] = b;
#endif
}

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
  if (R > 1 && n - j > kLanes && n >= kWide * kLanes) {  // two narrow sums take as long as two wide
    product<R, kWide>(a, am, ak, b + n - kWide * kLanes, bk, c + n - kWide * kLanes, n, k);
    return;
  }
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

// The same for one column, of as many rows of c as there are lanes; a is by rows, `am` apart.
TERRAIN_INLINE void column(const double* a, int64_t am, const double* b, int64_t bk, double* c,
                           int64_t k) {
  Lanes sum = {};
  int64_t l = 0;
  for (; l + kLanes <= k; l += kLanes) {
    Lanes block[kLanes];
    for (int64_t t = 0; t < kLanes; ++t) block[t] = lanes(a + t * am + l);
    transpose(block);
    for (int64_t t = 0; t < kLanes; ++t) sum += block[t] * b[(l + t) * bk];
  }
  for (; l < k; ++l) {
    Lanes next;
    for (int64_t t = 0; t < kLanes; ++t) next[t] = a[t * am + l];
    sum += next * b[l * bk];
  }
  lanes(c) = sum;
}

// c [m, n] = a [m, k] b [k, n], a by strides, b and c by rows
__attribute__((noinline)) inline void multiply(const double* a, int64_t am, int64_t ak,
                                               const double* b, int64_t bk, double* c, int64_t m,
                                               int64_t k, int64_t n) {
  int64_t i = 0;
  if (n < kLanes) {
    if (kLanes > 2 && n == 1 && ak == 1)  // two at once gain nothing
      for (; i + kLanes <= m; i += kLanes) column(a + i * am, am, b, bk, c + i, k);
    for (; i + 8 <= m; i += 8) narrow_rows<8>(a + i * am, am, ak, b, bk, c + i * n, k, n);
    for (; i + 4 <= m; i += 4) narrow_rows<4>(a + i * am, am, ak, b, bk, c + i * n, k, n);
    for (; i < m; ++i) narrow_rows<1>(a + i * am, am, ak, b, bk, c + i * n, k, n);
    return;
  }
  for (; i + 4 <= m; i += 4) rows<4>(a + i * am, am, ak, b, bk, c + i * n, k, n);
  for (; i + 2 <= m; i += 2) rows<2>(a + i * am, am, ak, b, bk, c + i * n, k, n);
  if (i < m) rows<1>(a + i * am, am, ak, b, bk, c + i * n, k, n);
}

// Column j of the factor below its diagonal, of R rows from i on, of kLanes systems side by side.
template <int R>
TERRAIN_INLINE void column_of_factor(Lanes* l, int64_t n, int64_t j, int64_t i) {
  Lanes sum[R];
  for (int r = 0; r < R; ++r) sum[r] = l[(i + r) * n + j];
  for (int64_t k = 0; k < j; ++k)
    for (int r = 0; r < R; ++r) sum[r] -= l[(i + r) * n + k] * l[j * n + k];
  for (int r = 0; r < R; ++r) l[(i + r) * n + j] = sum[r] / l[j * n + j];
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
    int64_t i = j + 1;
    for (; i + 4 <= n; i += 4) column_of_factor<4>(l, n, j, i);
    for (; i < n; ++i) column_of_factor<1>(l, n, j, i);
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

// C columns of X of L X = B in place [n, m], of kLanes systems side by side.
template <int C>
TERRAIN_INLINE void forward(const Lanes* l, Lanes* x, int64_t n, int64_t m) {
  for (int64_t i = 0; i < n; ++i) {
    Lanes sum[C];
    for (int c = 0; c < C; ++c) sum[c] = x[i * m + c];
    for (int64_t k = 0; k < i; ++k)
      for (int c = 0; c < C; ++c) sum[c] -= l[i * n + k] * x[k * m + c];
    for (int c = 0; c < C; ++c) x[i * m + c] = sum[c] / l[i * n + i];
  }
}

// The same of L' X = B.
template <int C>
TERRAIN_INLINE void backward(const Lanes* l, Lanes* x, int64_t n, int64_t m) {
  for (int64_t i = n - 1; i >= 0; --i) {
    Lanes sum[C];
    for (int c = 0; c < C; ++c) sum[c] = x[i * m + c];
    for (int64_t k = i + 1; k < n; ++k)
      for (int c = 0; c < C; ++c) sum[c] -= l[k * n + i] * x[k * m + c];
    for (int c = 0; c < C; ++c) x[i * m + c] = sum[c] / l[i * n + i];
  }
}

// All m columns of X of L X = B, or of L L' X = B.
inline void solve(const Lanes* l, Lanes* x, int64_t n, int64_t m, bool both) {
  int64_t c = 0;
  for (; c + 4 <= m; c += 4) {
    forward<4>(l, x + c, n, m);
    if (both) backward<4>(l, x + c, n, m);
  }
  for (; c < m; ++c) {
    forward<1>(l, x + c, n, m);
    if (both) backward<1>(l, x + c, n, m);
  }
}

// Lays up to kLanes matrices of `count` numbers side by side, the last one as often as needed.
inline void gather(Lanes* to, const double* from, int64_t step, int64_t number, int64_t count) {
  const double* each[kLanes];
  for (int64_t t = 0; t < kLanes; ++t) each[t] = from + std::min(t, number - 1) * step;
  int64_t i = 0;
  for (; i + kLanes <= count; i += kLanes) {
    Lanes block[kLanes];
    for (int64_t t = 0; t < kLanes; ++t) block[t] = lanes(each[t] + i);
    transpose(block);
    for (int64_t t = 0; t < kLanes; ++t) to[i + t] = block[t];
  }
  for (; i < count; ++i)
    for (int64_t t = 0; t < kLanes; ++t) to[i][t] = each[t][i];
}
inline void scatter(double* to, const Lanes* from, int64_t step, int64_t number, int64_t count) {
  int64_t i = 0;
  for (; i + kLanes <= count; i += kLanes) {
    Lanes block[kLanes];
    for (int64_t t = 0; t < kLanes; ++t) block[t] = from[i + t];
    transpose(block);
#pragma GCC unroll 8
    for (int64_t t = 0; t < kLanes; ++t)
      if (t < number) lanes(to + t * step + i) = block[t];
  }
  for (; i < count; ++i)
    for (int64_t t = 0; t < std::min(number, kLanes); ++t) to[t * step + i] = from[i][t];
}

}  // namespace terrain::detail
