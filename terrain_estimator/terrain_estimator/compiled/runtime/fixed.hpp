// SPDX-FileCopyrightText: 2026 The terrain_estimator authors
// SPDX-License-Identifier: Apache-2.0
//
// What the fixed forms need beside the operators: operators on single numbers, and tests of sizes.

#pragma once

#include "operators.hpp"

namespace terrain {

namespace scalar {

TERRAIN_INLINE double same(double v) { return v; }
TERRAIN_INLINE double cube(double v) { return v * v * v; }
TERRAIN_INLINE double where(double c, double x, double y) { return c != 0.0 ? x : y; }
TERRAIN_INLINE double addcmul(double x, double y, double z) { return x + y * z; }
TERRAIN_INLINE double lerp(double x, double y, double w) {
  return w < 0.5 ? x + w * (y - x) : y - (y - x) * (1.0 - w);
}
TERRAIN_INLINE double larger(double a, double b) { return a > b || a != a ? a : b; }
TERRAIN_INLINE double smaller(double a, double b) { return a < b || a != a ? a : b; }

}  // namespace scalar

// A view of a tensor that lies by rows.
inline Tensor strided(const Tensor& x, Kind kind, int64_t offset,
                      std::initializer_list<int64_t> sizes,
                      std::initializer_list<int64_t> strides) {
  Tensor out = x.bare();
  out.set_kind(kind);
  auto stride = strides.begin();
  for (int64_t size : sizes) out.add_dimension(size, *stride++);
  out.move(offset);
  return out;
}

namespace fixed {

inline bool fits(const Tensor& x, Kind kind, std::initializer_list<int64_t> sizes) {
  if (!x.defined() || x.kind() != kind || x.dimensions() != static_cast<int>(sizes.size()))
    return false;
  int d = 0;
  for (int64_t size : sizes)
    if (x.size(d++) != size) return false;
  return true;
}

// A matrix by rows.
inline void by_rows(const double* from, int64_t by_row, int64_t by_column, double* to, int64_t rows,
                    int64_t columns) {
  for (int64_t i = 0; i < rows; ++i)
    for (int64_t j = 0; j < columns; ++j) to[i * columns + j] = from[i * by_row + j * by_column];
}

// In place, in the order of the general form.
inline void softmax(double* x, int64_t count) {
  double most = -elementary::kInfinity, total = 0.0;
  for (int64_t i = 0; i < count; ++i) most = scalar::larger(most, x[i]);
  for (int64_t i = 0; i < count; ++i) x[i] = elementary::exp(x[i] - most);
  for (int64_t i = 0; i < count; ++i) total = total + x[i];
  for (int64_t i = 0; i < count; ++i) x[i] = x[i] / total;
}

}  // namespace fixed
}  // namespace terrain
