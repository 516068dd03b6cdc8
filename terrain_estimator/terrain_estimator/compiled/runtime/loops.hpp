// SPDX-FileCopyrightText: 2026 The terrain_estimator authors
// SPDX-License-Identifier: Apache-2.0
//
// Loops over the elements of several tensors at once, with broadcasting.

#pragma once

#include "elementary.hpp"
#include "tensor.hpp"

namespace terrain {

// The dimensions of a loop, those of length 1 left out and neighbours joined where all N operands
// allow it.
template <int N>
struct Loop {
  int dimensions = 0;
  int64_t sizes[kMostDimensions], strides[N][kMostDimensions];
  double* data[N];
  bool nothing = false;

  // From the outermost to the innermost.
  void add(int64_t size, const int64_t (&stride)[N]) {
    if (size == 1) return;
    if (size == 0) nothing = true;
    if (dimensions > 0) {
      bool joins = true;
      for (int k = 0; k < N; ++k) joins &= strides[k][dimensions - 1] == stride[k] * size;
      if (joins) {
        sizes[dimensions - 1] *= size;
        for (int k = 0; k < N; ++k) strides[k][dimensions - 1] = stride[k];
        return;
      }
    }
    sizes[dimensions] = size;
    for (int k = 0; k < N; ++k) strides[k][dimensions] = stride[k];
    ++dimensions;
  }

  // Calls row(n, pointers, strides) for each row of the innermost dimension.
  template <class Row>
  void run(Row row) const {
    if (nothing) return;
    // the two innermost dimensions, of length 1 where there are fewer
    const int inner = dimensions - 1, outer = dimensions - 2;
    const int64_t count = outer < 0 ? 1 : sizes[outer], length = inner < 0 ? 1 : sizes[inner];
    double* start[N];
    int64_t step[N], next[N];
    for (int k = 0; k < N; ++k) {
      start[k] = data[k];
      step[k] = inner < 0 ? 0 : strides[k][inner];
      next[k] = outer < 0 ? 0 : strides[k][outer];
    }
    int64_t index[kMostDimensions] = {};
    for (;;) {
      double* at[N];
      for (int k = 0; k < N; ++k) at[k] = start[k];
      for (int64_t i = 0; i < count; ++i) {
        row(length, at, step);
        for (int k = 0; k < N; ++k) at[k] += next[k];
      }
      int d = outer - 1;
      for (; d >= 0; --d) {
        for (int k = 0; k < N; ++k) start[k] += strides[k][d];
        if (++index[d] < sizes[d]) break;
        for (int k = 0; k < N; ++k) start[k] -= strides[k][d] * sizes[d];
        index[d] = 0;
      }
      if (d < 0) return;
    }
  }
};

// The stride of dimension d of `of` dimensions, zero where a tensor is broadcast along it.
inline int64_t broadcast_stride(const Tensor& x, int d, int of) {
  const int own = d - (of - x.dimensions());
  return own < 0 || x.size(own) == 1 ? 0 : x.stride(own);
}

inline bool same_sizes(const Tensor& a, const Tensor& b) {
  if (a.dimensions() != b.dimensions()) return false;
  for (int d = 0; d < a.dimensions(); ++d)
    if (a.size(d) != b.size(d)) return false;
  return true;
}

// The sizes to which all tensors are broadcast.
inline Integers common_sizes(std::initializer_list<const Tensor*> tensors) {
  int most = 0;
  for (const Tensor* x : tensors) most = std::max(most, x->dimensions());
  Integers sizes;
  for (int d = 0; d < most; ++d) {
    int64_t size = 1;
    for (const Tensor* x : tensors) {
      const int own = d - (most - x->dimensions());
      if (own < 0 || x->size(own) == 1) continue;
      require(size == 1 || size == x->size(own), "the sizes of tensors do not fit");
      size = x->size(own);
    }
    sizes.append(size);
  }
  return sizes;
}

// out[...] = f(a)
template <class F>
inline Tensor map(const Tensor& a, Kind kind, F f) {
  Tensor out = Tensor::empty_like(a, kind);
  double* to = out.data();
  if (a.contiguous()) {
    const double* from = a.data();
    const int64_t n = a.count();
    for (int64_t i = 0; i < n; ++i) to[i] = f(from[i]);
    return out;
  }
  Loop<2> loop;
  loop.data[0] = to;
  loop.data[1] = a.data();
  for (int d = 0; d < a.dimensions(); ++d) loop.add(a.size(d), {out.stride(d), a.stride(d)});
  loop.run([f](int64_t n, double** x, const int64_t* s) {
    double* to = x[0];
    const double* from = x[1];
    const int64_t step = s[1];
    for (int64_t i = 0; i < n; ++i) to[i] = f(from[i * step]);
  });
  return out;
}

// out[...] = f(a, b), broadcast
template <class F>
inline Tensor map(const Tensor& a, const Tensor& b, Kind kind, F f) {
  if (same_sizes(a, b) && a.contiguous() && b.contiguous()) {
    Tensor out = Tensor::empty_like(a, kind);
    double* __restrict to = out.data();
    const double *x = a.data(), *y = b.data();
    const int64_t n = a.count();
    for (int64_t i = 0; i < n; ++i) to[i] = f(x[i], y[i]);
    return out;
  }
  Tensor out = Tensor::empty(common_sizes({&a, &b}), kind);
  const int n = out.dimensions();
  Loop<3> loop;
  loop.data[0] = out.data();
  loop.data[1] = a.data();
  loop.data[2] = b.data();
  for (int d = 0; d < n; ++d)
    loop.add(out.size(d), {out.stride(d), broadcast_stride(a, d, n), broadcast_stride(b, d, n)});
  loop.run([f](int64_t n, double** x, const int64_t* s) {
    double* __restrict to = x[0];
    const double *a = x[1], *b = x[2];
    const int64_t p = s[1], q = s[2];
    if (p == 1 && q == 1)
      for (int64_t i = 0; i < n; ++i) to[i] = f(a[i], b[i]);
    else if (p == 1 && q == 0)
      for (int64_t i = 0; i < n; ++i) to[i] = f(a[i], *b);
    else if (p == 0 && q == 1)
      for (int64_t i = 0; i < n; ++i) to[i] = f(*a, b[i]);
    else
      for (int64_t i = 0; i < n; ++i) to[i] = f(a[i * p], b[i * q]);
  });
  return out;
}

// out[...] = f(a, b, c), broadcast
template <class F>
inline Tensor map(const Tensor& a, const Tensor& b, const Tensor& c, Kind kind, F f) {
  Tensor out = Tensor::empty(common_sizes({&a, &b, &c}), kind);
  const int n = out.dimensions();
  Loop<4> loop;
  loop.data[0] = out.data();
  loop.data[1] = a.data();
  loop.data[2] = b.data();
  loop.data[3] = c.data();
  for (int d = 0; d < n; ++d)
    loop.add(out.size(d), {out.stride(d), broadcast_stride(a, d, n), broadcast_stride(b, d, n),
                           broadcast_stride(c, d, n)});
  loop.run([f](int64_t n, double** x, const int64_t* s) {
    double* __restrict to = x[0];
    const double *a = x[1], *b = x[2], *c = x[3];
    if (s[1] == 1 && s[2] == 1 && s[3] == 1)
      for (int64_t i = 0; i < n; ++i) to[i] = f(a[i], b[i], c[i]);
    else
      for (int64_t i = 0; i < n; ++i) to[i] = f(a[i * s[1]], b[i * s[2]], c[i * s[3]]);
  });
  return out;
}

// to[...] = f(to, from) in place; `from` is broadcast to the sizes of `to`, whose strides may be 0.
template <class F>
inline void update(const Tensor& to, const Tensor& from, F f) {
  const int n = to.dimensions();
  Loop<2> loop;
  loop.data[0] = to.data();
  loop.data[1] = from.data();
  for (int d = 0; d < n; ++d) loop.add(to.size(d), {to.stride(d), broadcast_stride(from, d, n)});
  loop.run([f](int64_t n, double** x, const int64_t* s) {
    double* to = x[0];
    const double* from = x[1];
    const int64_t p = s[0], q = s[1];
    if (p == 0) {
      double sum = *to;
      for (int64_t i = 0; i < n; ++i) sum = f(sum, from[i * q]);
      *to = sum;
    } else if (p == 1 && q == 1) {
      for (int64_t i = 0; i < n; ++i) to[i] = f(to[i], from[i]);
    } else {
      for (int64_t i = 0; i < n; ++i) to[i * p] = f(to[i * p], from[i * q]);
    }
  });
}

// to[...] = f(to, a, b), likewise.
template <class F>
inline void update(const Tensor& to, const Tensor& a, const Tensor& b, F f) {
  const int n = to.dimensions();
  Loop<3> loop;
  loop.data[0] = to.data();
  loop.data[1] = a.data();
  loop.data[2] = b.data();
  for (int d = 0; d < n; ++d)
    loop.add(to.size(d), {to.stride(d), broadcast_stride(a, d, n), broadcast_stride(b, d, n)});
  loop.run([f](int64_t n, double** x, const int64_t* s) {
    double* __restrict to = x[0];
    const double *a = x[1], *b = x[2];
    if (s[0] == 0) {
      double sum = *to;
      for (int64_t i = 0; i < n; ++i) sum = f(sum, a[i * s[1]], b[i * s[2]]);
      *to = sum;
    } else if (s[0] == 1 && s[1] == 1 && s[2] == 1) {
      for (int64_t i = 0; i < n; ++i) to[i] = f(to[i], a[i], b[i]);
    } else {
      for (int64_t i = 0; i < n; ++i) to[i * s[0]] = f(to[i * s[0]], a[i * s[1]], b[i * s[2]]);
    }
  });
}

inline void copy_into(const Tensor& to, const Tensor& from) {
  if (same_sizes(to, from) && to.contiguous() && from.contiguous()) {
    std::memmove(to.data(), from.data(), 8 * static_cast<size_t>(to.count()));
    return;
  }
  const int n = to.dimensions();
  Loop<2> loop;
  loop.data[0] = to.data();
  loop.data[1] = from.data();
  for (int d = 0; d < n; ++d) loop.add(to.size(d), {to.stride(d), broadcast_stride(from, d, n)});
  loop.run([](int64_t n, double** x, const int64_t* s) {
    double* to = x[0];
    const double* from = x[1];
    const int64_t p = s[0], q = s[1];
    if (n == 3 && p == 1 && q == 1)  // most rows are of wheels or of a plane's directions
      std::memcpy(to, from, 3 * sizeof(double));
    else if (p == 1 && q == 1)
      for (int64_t i = 0; i < n; ++i) to[i] = from[i];
    else
      for (int64_t i = 0; i < n; ++i) to[i * p] = from[i * q];
  });
}

inline Tensor contiguous(const Tensor& x) {
  if (x.contiguous()) return x;
  Tensor out = Tensor::empty_like(x, x.kind());
  copy_into(out, x);
  return out;
}

}  // namespace terrain
