// SPDX-FileCopyrightText: 2026 The terrain_estimator authors
// SPDX-License-Identifier: Apache-2.0
//
// PyTorch's operators, by their names in ATen and with their meaning there.

#pragma once

#include <cmath>

#include "elementary.hpp"
#include "kernels.hpp"
#include "loops.hpp"
#include "series.hpp"

namespace terrain {

using Place = std::optional<int64_t>;

// ---- numbers

inline double rounded(double value, Kind kind) {
  return kind == Kind::kSingle ? static_cast<double>(static_cast<float>(value)) : value;
}

// The kind of a tensor with a number: the number's only counts where it is of a higher sort.
inline Kind promoted(Kind tensor, Scalar number) {
  if (number.kind <= tensor || (tensor == Kind::kSingle && number.kind == Kind::kReal))
    return tensor;
  return number.kind == Kind::kReal ? Kind::kSingle : number.kind;
}

// The kind of two tensors: one without dimensions counts like a number of its sort.
inline Kind promoted(const Tensor& a, const Tensor& b) {
  const Kind x = a.kind(), y = b.kind();
  const auto sort = [](Kind k) { return k == Kind::kReal ? Kind::kSingle : k; };
  if (a.dimensions() == 0 && b.dimensions() > 0 && sort(x) <= sort(y)) return y;
  if (b.dimensions() == 0 && a.dimensions() > 0 && sort(y) <= sort(x)) return x;
  return std::max(x, y);
}

// Numbers that are not whole: integers become singles, as PyTorch has it.
inline Kind fractional(Kind kind) { return kind < Kind::kSingle ? Kind::kSingle : kind; }

inline Tensor as_kind(const Tensor& x, Kind kind) {
  if (x.kind() == kind) return x;
  switch (kind) {
    case Kind::kBoolean:
      return map(x, kind, [](double v) { return v != 0.0 ? 1.0 : 0.0; });
    case Kind::kInteger:
      return map(x, kind, [](double v) { return std::trunc(v); });
    case Kind::kSingle:
      return map(x, kind, [](double v) { return rounded(v, Kind::kSingle); });
    default:
      return map(x, kind, [](double v) { return v; });
  }
}

// Singles are held as doubles: each result is rounded.
inline Tensor settled(const Tensor& x) {
  if (x.kind() != Kind::kSingle) return x;
  return map(x, Kind::kSingle, [](double v) { return rounded(v, Kind::kSingle); });
}

inline Tensor number_for(const Tensor& x, Scalar value) {
  Tensor made = Tensor::of(value);
  made.set_kind(promoted(x.kind(), value));
  return made;
}

// PyTorch's codes of a dtype.
inline Kind kind_of(int64_t dtype) {
  switch (dtype) {
    case 4:
    case 3:
      return Kind::kInteger;
    case 6:
      return Kind::kSingle;
    case 7:
      return Kind::kReal;
    case 11:
      return Kind::kBoolean;
    default:
      fail("a dtype is not known");
  }
}

inline int64_t dtype(const Tensor& x) {
  constexpr int64_t kCodes[] = {11, 4, 6, 7};
  return kCodes[static_cast<int>(x.kind())];
}

inline bool is_none(const Tensor& x) { return !x.defined(); }
template <class T>
bool is_none(const std::optional<T>& x) {
  return !x.has_value();
}

inline bool truth(const Tensor& x) { return x.item() != 0.0; }
inline int64_t integer(const Tensor& x) { return static_cast<int64_t>(x.item()); }

// ---- one tensor

#define TERRAIN_UNARY(name, expression)                                      \
  namespace scalar { TERRAIN_INLINE double name(double v) { return expression; } } \
  inline Tensor name(const Tensor& x) {                                      \
    return settled(map(x, fractional(x.kind()), [](double v) TERRAIN_INNER { return expression; })); \
  }
TERRAIN_UNARY(reciprocal, 1.0 / v)
TERRAIN_UNARY(sqrt, std::sqrt(v))
TERRAIN_UNARY(tan, elementary::sin(v) / elementary::cos(v))
TERRAIN_UNARY(erfc, elementary::erfc(v))
#undef TERRAIN_UNARY

#define TERRAIN_SERIES(name)                                   \
  inline Tensor name(const Tensor& x) {                        \
    const Tensor rows = contiguous(x);                         \
    Tensor out = Tensor::empty_like(rows, fractional(x.kind())); \
    series::name(rows.data(), out.data(), out.count());        \
    return settled(out);                                       \
  }
TERRAIN_SERIES(sin)
TERRAIN_SERIES(cos)
TERRAIN_SERIES(asin)
TERRAIN_SERIES(tanh)
TERRAIN_SERIES(exp)
TERRAIN_SERIES(expm1)
TERRAIN_SERIES(log)
#undef TERRAIN_SERIES

#define TERRAIN_SAME_KIND(name, expression) \
  namespace scalar { TERRAIN_INLINE double name(double v) { return expression; } } \
  inline Tensor name(const Tensor& x) {     \
    return map(x, x.kind(), [](double v) TERRAIN_INNER { return expression; }); \
  }
TERRAIN_SAME_KIND(neg, -v)
TERRAIN_SAME_KIND(abs, std::fabs(v))
TERRAIN_SAME_KIND(square, v* v)
TERRAIN_SAME_KIND(sign, static_cast<double>((v > 0.0) - (v < 0.0)))
TERRAIN_SAME_KIND(clone, v)
TERRAIN_SAME_KIND(floor, std::floor(v))
#undef TERRAIN_SAME_KIND

#define TERRAIN_TEST(name, expression)  \
  namespace scalar { TERRAIN_INLINE double name(double v) { return (expression) ? 1.0 : 0.0; } } \
  inline Tensor name(const Tensor& x) { \
    return map(x, Kind::kBoolean, [](double v) TERRAIN_INNER { return (expression) ? 1.0 : 0.0; }); \
  }
TERRAIN_TEST(isfinite, std::fabs(v) < elementary::kInfinity)
TERRAIN_TEST(isnan, v != v)
TERRAIN_TEST(isinf, std::fabs(v) == elementary::kInfinity)
TERRAIN_TEST(logical_not, v == 0.0)
#undef TERRAIN_TEST

// ---- two tensors, or a tensor and a number

#define TERRAIN_BINARY(name, kind_from, expression)                                        \
  namespace scalar { TERRAIN_INLINE double name(double x, double y) { return expression; } } \
  inline Tensor name(const Tensor& a, const Tensor& b) {                                   \
    return settled(map(a, b, kind_from(promoted(a, b)),                                    \
                       [](double x, double y) TERRAIN_INNER { return expression; }));                    \
  }                                                                                        \
  inline Tensor name(const Tensor& a, Scalar b) {                                          \
    const double y = rounded(b.value, promoted(a.kind(), b));                              \
    return settled(map(a, kind_from(promoted(a.kind(), b)), [y](double x) TERRAIN_INNER { return expression; })); \
  }
// with the sign of the divisor
inline double python_remainder(double x, double y) {
  const double rest = std::fmod(x, y);
  return rest != 0.0 && (y < 0.0) != (rest < 0.0) ? rest + y : rest;
}
inline Kind unchanged(Kind kind) { return kind; }
inline Kind truth_value(Kind) { return Kind::kBoolean; }
TERRAIN_BINARY(add, unchanged, x + y)
TERRAIN_BINARY(sub, unchanged, x - y)
TERRAIN_BINARY(mul, unchanged, x* y)
TERRAIN_BINARY(div, fractional, x / y)
TERRAIN_BINARY(remainder, unchanged, python_remainder(x, y))
TERRAIN_BINARY(lt, truth_value, (x < y ? 1.0 : 0.0))
TERRAIN_BINARY(le, truth_value, (x <= y ? 1.0 : 0.0))
TERRAIN_BINARY(gt, truth_value, (x > y ? 1.0 : 0.0))
TERRAIN_BINARY(ge, truth_value, (x >= y ? 1.0 : 0.0))
TERRAIN_BINARY(eq, truth_value, (x == y ? 1.0 : 0.0))
TERRAIN_BINARY(ne, truth_value, (x != y ? 1.0 : 0.0))
TERRAIN_BINARY(logical_and, truth_value, (x != 0.0 && y != 0.0 ? 1.0 : 0.0))
TERRAIN_BINARY(logical_or, truth_value, (x != 0.0 || y != 0.0 ? 1.0 : 0.0))
// NaN where one is NaN
TERRAIN_BINARY(minimum, unchanged, (x < y || x != x ? x : y))
TERRAIN_BINARY(maximum, unchanged, (x > y || x != x ? x : y))
TERRAIN_BINARY(atan2, fractional, elementary::atan2(x, y))
#undef TERRAIN_BINARY

inline Tensor rsub(const Tensor& a, Scalar b) { return neg(sub(a, b)); }

inline Tensor pow(const Tensor& a, Scalar b) {
  const Kind kind = promoted(a.kind(), b);
  const double y = b.value;
  if (y == 2.0) return settled(map(a, kind, [](double x) { return x * x; }));
  if (y == 3.0) return settled(map(a, kind, [](double x) { return x * x * x; }));
  if (y == 0.5) return settled(map(a, kind, [](double x) { return std::sqrt(x); }));
  if (y == -0.5) return settled(map(a, kind, [](double x) { return 1.0 / std::sqrt(x); }));
  if (y == -1.0) return settled(map(a, kind, [](double x) { return 1.0 / x; }));
  if (y == -2.0) return settled(map(a, kind, [](double x) { return 1.0 / (x * x); }));
  return settled(map(a, kind, [y](double x) TERRAIN_INNER { return elementary::pow(x, y); }));
}

inline Tensor igamma(const Tensor& a, const Tensor& x) {
  return map(a, x, promoted(a, x),
             [](double p, double q) { return elementary::igamma(p, q); });
}

inline Tensor addcmul(const Tensor& a, const Tensor& b, const Tensor& c, Scalar value) {
  require(value.value == 1.0, "addcmul takes the value 1 alone");
  return map(a, b, c, a.kind(), [](double x, double y, double z) { return x + y * z; });
}

inline Tensor lerp(const Tensor& a, const Tensor& b, Scalar weight) {
  const double w = weight.value;
  return map(a, b, a.kind(), [w](double x, double y) {
    return w < 0.5 ? x + w * (y - x) : y - (y - x) * (1.0 - w);
  });
}

inline Tensor where(const Tensor& condition, const Tensor& a, const Tensor& b) {
  return map(condition, a, b, promoted(a, b),
             [](double c, double x, double y) { return c != 0.0 ? x : y; });
}
inline Tensor where(const Tensor& condition, const Tensor& a, Scalar b) {
  return where(condition, a, number_for(a, b));
}
inline Tensor where(const Tensor& condition, Scalar a, const Tensor& b) {
  return where(condition, number_for(b, a), b);
}

inline Tensor clamp(const Tensor& x, std::optional<Scalar> low, std::optional<Scalar> high) {
  Tensor y = x;
  if (low) y = maximum(y, *low);
  return high ? minimum(y, *high) : y;
}

inline Tensor nan_to_num(const Tensor& x, double number) {
  constexpr double most = std::numeric_limits<double>::max();
  return map(x, x.kind(), [number](double v) TERRAIN_INNER {
    return v != v ? number : (v > most ? most : (v < -most ? -most : v));
  });
}

// ---- views

inline Integers size(const Tensor& x) {
  Integers sizes;
  for (int64_t n : x.extent()) sizes.append(n);
  return sizes;
}
inline int64_t size(const Tensor& x, int64_t d) { return x.size(x.place_of(d)); }

inline Tensor narrow(const Tensor& x, int64_t dimension, int64_t start, int64_t length) {
  const int at = x.place_of(dimension);
  if (start < 0) start += x.size(at);
  require(start >= 0 && length >= 0 && start + length <= x.size(at), "a part is out of range");
  Tensor out = x.bare();
  for (int d = 0; d < x.dimensions(); ++d)
    out.add_dimension(d == at ? length : x.size(d), x.stride(d));
  out.move(start * x.stride(at));
  return out;
}

inline Tensor slice(const Tensor& x, int64_t dimension, Place start, Place end, int64_t step) {
  const int at = x.place_of(dimension);
  const int64_t n = x.size(at);
  const auto inside = [n](int64_t place) {
    return std::clamp(place < 0 ? place + n : place, int64_t{0}, n);
  };
  const int64_t first = inside(start.value_or(0)), last = inside(end.value_or(n));
  const int64_t count = last > first ? (last - first + step - 1) / step : 0;
  Tensor out = x.bare();
  for (int d = 0; d < x.dimensions(); ++d)
    out.add_dimension(d == at ? count : x.size(d), x.stride(d) * (d == at ? step : 1));
  out.move(first * x.stride(at));
  return out;
}

inline Tensor select(const Tensor& x, int64_t dimension, int64_t place) {
  const int at = x.place_of(dimension);
  if (place < 0) place += x.size(at);
  require(place >= 0 && place < x.size(at), "a place is out of range");
  Tensor out = x.bare();
  for (int d = 0; d < x.dimensions(); ++d)
    if (d != at) out.add_dimension(x.size(d), x.stride(d));
  out.move(place * x.stride(at));
  return out;
}

inline Tensor unsqueeze(const Tensor& x, int64_t dimension) {
  const int at = x.place_of(dimension, 1);
  Tensor out = x.bare();
  for (int d = 0; d <= x.dimensions(); ++d) {
    if (d == at)
      out.add_dimension(1, d < x.dimensions() ? x.size(d) * x.stride(d) : 1);
    if (d < x.dimensions()) out.add_dimension(x.size(d), x.stride(d));
  }
  return out;
}

inline Tensor squeeze(const Tensor& x, int64_t dimension) {
  const int at = x.place_of(dimension);
  if (x.dimensions() == 0 || x.size(at) != 1) return x;
  return select(x, at, 0);
}

inline Tensor permute(const Tensor& x, const Integers& order) {
  require(order.count() == x.dimensions(), "permute needs every dimension");
  Tensor out = x.bare();
  for (int64_t d : order) out.add_dimension(x.size(x.place_of(d)), x.stride(x.place_of(d)));
  return out;
}

inline Tensor transpose(const Tensor& x, int64_t first, int64_t second) {
  Integers order;
  for (int d = 0; d < x.dimensions(); ++d) order.append(d);
  std::swap(order[x.place_of(first)], order[x.place_of(second)]);
  return permute(x, order);
}

inline Tensor numpy_T(const Tensor& x) {
  Integers order;
  for (int d = x.dimensions() - 1; d >= 0; --d) order.append(d);
  return permute(x, order);
}

inline Tensor movedim(const Tensor& x, const Integers& from, const Integers& to) {
  require(from.count() == to.count(), "movedim needs as many places as dimensions");
  int order[kMostDimensions], taken[kMostDimensions] = {};
  std::fill(order, order + kMostDimensions, -1);
  for (int64_t k = 0; k < from.count(); ++k) {
    order[x.place_of(to[k])] = x.place_of(from[k]);
    taken[x.place_of(from[k])] = 1;
  }
  Integers all;
  for (int d = 0, next = 0; d < x.dimensions(); ++d) {
    if (order[d] < 0) {
      while (taken[next]) ++next;
      taken[next] = 1;
      order[d] = next;
    }
    all.append(order[d]);
  }
  return permute(x, all);
}

inline Tensor expand(const Tensor& x, const Integers& sizes) {
  const int64_t more = sizes.count() - x.dimensions();
  require(more >= 0, "expand needs at least the tensor's dimensions");
  Tensor out = x.bare();
  for (int64_t d = 0; d < sizes.count(); ++d) {
    const int own = static_cast<int>(d - more);
    const int64_t had = own < 0 ? 1 : x.size(own), wanted = sizes[d] < 0 ? had : sizes[d];
    require(had == 1 || had == wanted, "expand cannot change a size that is not 1");
    out.add_dimension(wanted, own < 0 || (had == 1 && wanted != 1) ? 0 : x.stride(own));
  }
  return out;
}

inline Tensor pow(const Tensor& a, const Tensor& b) {
  const Integers sizes = common_sizes({&a, &b});
  const Tensor base = contiguous(expand(a, sizes)), power = contiguous(expand(b, sizes));
  Tensor out = Tensor::empty_like(base, promoted(a, b));
  series::pow(base.data(), power.data(), out.data(), out.count());
  return settled(out);
}

inline Tensor diagonal(const Tensor& x, int64_t offset, int64_t first, int64_t second) {
  require(offset == 0, "diagonal takes no offset");
  const int a = x.place_of(first), b = x.place_of(second);
  Tensor out = x.bare();
  for (int d = 0; d < x.dimensions(); ++d)
    if (d != a && d != b) out.add_dimension(x.size(d), x.stride(d));
  out.add_dimension(std::min(x.size(a), x.size(b)), x.stride(a) + x.stride(b));
  return out;
}

inline List<Tensor> broadcast_tensors(const List<Tensor>& tensors) {
  Integers sizes;
  for (const Tensor& x : tensors) {
    Tensor so_far = Tensor::empty(sizes, Kind::kReal);
    sizes = common_sizes({&so_far, &x});
  }
  List<Tensor> all;
  for (const Tensor& x : tensors) all.append(expand(x, sizes));
  return all;
}

inline Integers inferred(const Tensor& x, const Integers& sizes) {
  Integers whole;
  int64_t known = 1, open = -1;
  for (int64_t d = 0; d < sizes.count(); ++d) {
    whole.append(sizes[d]);
    if (sizes[d] == -1)
      open = d;
    else
      known *= sizes[d];
  }
  const int64_t count = x.count();
  if (open >= 0) whole[open] = known ? count / known : 0;
  require(open >= 0 ? known && count % known == 0 : known == count, "a view needs all elements");
  return whole;
}

// The tensor with other sizes and the same memory; undefined where its strides do not allow it.
inline Tensor viewed(const Tensor& x, const Integers& sizes) {
  Tensor out = x.bare();
  if (x.contiguous()) {
    int64_t strides[kMostDimensions], stride = 1;
    require(sizes.count() <= kMostDimensions, "more dimensions than a tensor may have");
    for (int64_t d = sizes.count() - 1; d >= 0; --d) {
      strides[d] = stride;
      stride *= std::max(sizes[d], int64_t{1});
    }
    for (int64_t d = 0; d < sizes.count(); ++d) out.add_dimension(sizes[d], strides[d]);
    return out;
  }
  // each run of old dimensions that lie one behind the other makes a run of new ones
  int64_t strides[kMostDimensions];
  int64_t d = sizes.count() - 1;
  int64_t run = 1, made = 1;
  int64_t base = x.dimensions() ? x.stride(x.dimensions() - 1) : 1;
  for (int old = x.dimensions() - 1; old >= 0; --old) {
    run *= x.size(old);
    if (old > 0 && (x.size(old - 1) == 1 || x.stride(old - 1) == run * base)) continue;
    while (d >= 0 && (made < run || sizes[d] == 1)) {
      strides[d] = made * base;
      made *= sizes[d];
      --d;
    }
    if (made != run) return Tensor();
    if (old > 0) {
      base = x.stride(old - 1);
      run = made = 1;
    }
  }
  if (d != -1) return Tensor();
  for (int64_t k = 0; k < sizes.count(); ++k) out.add_dimension(sizes[k], strides[k]);
  return out;
}

inline Tensor reshape(const Tensor& x, const Integers& sizes) {
  const Integers whole = inferred(x, sizes);
  Tensor out = viewed(x, whole);
  return out.defined() ? out : viewed(contiguous(x), whole);
}

inline Tensor view(const Tensor& x, const Integers& sizes) {
  Tensor out = viewed(x, inferred(x, sizes));
  require(out.defined(), "a view of these sizes needs a copy");
  return out;
}

inline Tensor flatten(const Tensor& x, int64_t first, int64_t last) {
  Integers sizes;
  if (x.dimensions() == 0) return reshape(x, {1});
  const int a = x.place_of(first), b = x.place_of(last);
  for (int d = 0; d < x.dimensions(); ++d) {
    if (d > a && d <= b)
      sizes[-1] *= x.size(d);
    else
      sizes.append(x.size(d));
  }
  return reshape(x, sizes);
}

inline Tensor unflatten(const Tensor& x, int64_t dimension, const Integers& parts) {
  const int at = x.place_of(dimension);
  Integers sizes;
  int64_t known = 1;
  for (int64_t n : parts)
    if (n != -1) known *= n;
  for (int d = 0; d < x.dimensions(); ++d) {
    if (d != at) {
      sizes.append(x.size(d));
      continue;
    }
    for (int64_t n : parts) sizes.append(n == -1 ? x.size(d) / known : n);
  }
  return view(x, sizes);
}

inline List<Tensor> unbind(const Tensor& x, int64_t dimension) {
  List<Tensor> parts;
  const int at = x.place_of(dimension);
  for (int64_t k = 0; k < x.size(at); ++k) parts.append(select(x, at, k));
  return parts;
}

inline List<Tensor> split_with_sizes(const Tensor& x, const Integers& sizes, int64_t dimension) {
  List<Tensor> parts;
  int64_t start = 0;
  for (int64_t n : sizes) {
    parts.append(narrow(x, dimension, start, n));
    start += n;
  }
  return parts;
}

// ---- new tensors

inline Tensor full(const Integers& sizes, Scalar value, Kind kind) {
  Tensor out = Tensor::empty(sizes, kind);
  std::fill(out.data(), out.data() + out.count(), value.value);
  return out;
}
inline Tensor full_like(const Tensor& x, Scalar value, Kind kind) {
  Tensor out = Tensor::empty_like(x, kind);
  std::fill(out.data(), out.data() + out.count(), value.value);
  return out;
}

inline Tensor arange(Scalar start, Scalar end, Scalar step, Kind kind) {
  const auto count = static_cast<int64_t>(std::ceil((end.value - start.value) / step.value));
  Tensor out = Tensor::empty(Integers{std::max(count, int64_t{0})}, kind);
  for (int64_t k = 0; k < out.count(); ++k)
    out.data()[k] = start.value + static_cast<double>(k) * step.value;
  return out;
}

inline Tensor eye(int64_t n, int64_t m, Kind kind) {
  Tensor out = full({n, m}, 0.0, kind);
  for (int64_t k = 0; k < std::min(n, m); ++k) out.data()[k * m + k] = 1.0;
  return out;
}

inline Tensor cat(std::initializer_list<Tensor> parts, int64_t dimension);

inline Tensor cat(const Tensor* parts, int64_t number, int64_t dimension) {
  // PyTorch leaves empty vectors out, whatever the others are
  const auto counts = [](const Tensor& x) { return !(x.dimensions() == 1 && x.size(0) == 0); };
  const Tensor* like = nullptr;
  Kind kind = parts[0].kind();
  int64_t total = 0;
  int at = 0;
  for (int64_t k = 0; k < number; ++k) {
    kind = std::max(kind, parts[k].kind());
    if (!counts(parts[k])) continue;
    if (!like) {
      like = &parts[k];
      at = like->place_of(dimension);
    }
    require(parts[k].dimensions() == like->dimensions(), "cat needs as many dimensions in all");
    total += parts[k].size(at);
  }
  if (!like) return parts[0];
  Integers sizes = size(*like);
  sizes[at] = total;
  Tensor out = Tensor::empty(sizes, kind);
  int64_t start = 0;
  for (int64_t k = 0; k < number; ++k) {
    if (!counts(parts[k])) continue;
    const int64_t length = parts[k].size(at);
    const Tensor place = narrow(out, at, start, length);
    require(same_sizes(place, parts[k]), "cat needs equal sizes");
    copy_into(place, parts[k]);
    start += length;
  }
  return out;
}
inline Tensor cat(std::initializer_list<Tensor> parts, int64_t dimension) {
  return cat(parts.begin(), static_cast<int64_t>(parts.size()), dimension);
}
inline Tensor cat(const List<Tensor>& parts, int64_t dimension) {
  return cat(parts.begin(), parts.count(), dimension);
}

inline Tensor stack(const Tensor* parts, int64_t number, int64_t dimension) {
  const int at = parts[0].place_of(dimension, 1);
  Integers sizes;
  Kind kind = parts[0].kind();
  for (int d = 0; d <= parts[0].dimensions(); ++d) {
    if (d == at) sizes.append(number);
    if (d < parts[0].dimensions()) sizes.append(parts[0].size(d));
  }
  for (int64_t k = 0; k < number; ++k) kind = std::max(kind, parts[k].kind());
  Tensor out = Tensor::empty(sizes, kind);
  for (int64_t k = 0; k < number; ++k) {
    require(same_sizes(parts[k], parts[0]), "stack needs equal sizes");
    copy_into(select(out, at, k), parts[k]);
  }
  return out;
}
inline Tensor stack(std::initializer_list<Tensor> parts, int64_t dimension) {
  return stack(parts.begin(), static_cast<int64_t>(parts.size()), dimension);
}
inline Tensor stack(const List<Tensor>& parts, int64_t dimension) {
  return stack(parts.begin(), parts.count(), dimension);
}

inline Tensor pad(const Tensor& x, const Integers& margins, double value) {
  Integers sizes = size(x);
  Tensor inner;
  for (int64_t k = 0; k < margins.count() / 2; ++k)
    sizes[-1 - k] += margins[2 * k] + margins[2 * k + 1];
  Tensor out = full(sizes, value, x.kind());
  inner = out;
  for (int64_t k = 0; k < margins.count() / 2; ++k) {
    require(margins[2 * k] >= 0 && margins[2 * k + 1] >= 0, "pad takes nothing away");
    inner = narrow(inner, -1 - k, margins[2 * k], size(x, -1 - k));
  }
  copy_into(inner, x);
  return out;
}

inline Tensor repeat(const Tensor& x, const Integers& times) {
  const int64_t more = times.count() - x.dimensions();
  require(more >= 0, "repeat needs a number for each dimension");
  // [times, size] for each dimension, broadcast along the first of the two
  Integers sizes;
  Tensor from = x.bare();
  Integers doubled;
  for (int64_t d = 0; d < times.count(); ++d) {
    const int own = static_cast<int>(d - more);
    const int64_t n = own < 0 ? 1 : x.size(own);
    sizes.append(n * times[d]);
    from.add_dimension(times[d], 0);
    from.add_dimension(n, own < 0 ? 0 : x.stride(own));
  }
  return viewed(contiguous(from), sizes);
}

inline Tensor repeat_interleave(const Tensor& x, int64_t times, Place dimension) {
  if (!dimension) return repeat_interleave(flatten(x, 0, -1), times, 0);
  const int at = x.place_of(*dimension);
  Tensor from = x.bare();
  Integers sizes = size(x);
  sizes[at] *= times;
  for (int d = 0; d < x.dimensions(); ++d) {
    from.add_dimension(x.size(d), x.stride(d));
    if (d == at) from.add_dimension(times, 0);
  }
  return viewed(contiguous(from), sizes);
}

inline Tensor diag_embed(const Tensor& x) {
  Integers sizes = size(x);
  sizes.append(sizes[-1]);
  Tensor out = full(sizes, 0.0, x.kind());
  copy_into(diagonal(out, 0, -2, -1), x);
  return out;
}

inline Tensor diag(const Tensor& x) {
  return x.dimensions() == 1 ? diag_embed(x) : clone(diagonal(x, 0, 0, 1));
}

// ---- choosing

inline Tensor nonzero(const Tensor& x) {
  require(x.dimensions() == 1, "nonzero takes a vector");
  Integers places;
  for (int64_t k = 0; k < x.size(0); ++k)
    if (x.data()[k * x.stride(0)] != 0.0) places.append(k);
  Tensor out = Tensor::empty(Integers{places.count(), 1}, Kind::kInteger);
  for (int64_t k = 0; k < places.count(); ++k) out.data()[k] = static_cast<double>(places[k]);
  return out;
}

// The parts at `places` (of any shape) along one dimension.
inline Tensor taken(const Tensor& x, int at, const Tensor& places) {
  Integers sizes;
  for (int d = 0; d < x.dimensions(); ++d) {
    if (d != at) {
      sizes.append(x.size(d));
      continue;
    }
    for (int64_t n : places.extent()) sizes.append(n);
  }
  const Tensor index = contiguous(places);
  const int64_t count = index.count();
  Integers flat = size(x);
  flat[at] = count;
  Tensor out = Tensor::empty(flat, x.kind());
  for (int64_t k = 0; k < count; ++k)
    copy_into(select(out, at, k), select(x, at, static_cast<int64_t>(index.data()[k])));
  return viewed(out, sizes);
}

inline Tensor index_select(const Tensor& x, int64_t dimension, const Tensor& places) {
  return taken(x, x.place_of(dimension), places);
}

// x[..., places, ...] with one tensor of indices or one mask
inline Tensor index(const Tensor& x, std::initializer_list<Tensor> indices) {
  int at = -1, d = 0;
  Tensor places;
  for (const Tensor& given : indices) {
    if (given.defined()) {
      require(at < 0, "an index takes one tensor alone");
      at = d;
      places = given.kind() == Kind::kBoolean ? squeeze(nonzero(given), 1) : given;
    }
    ++d;
  }
  return at < 0 ? x : taken(x, at, places);
}

inline Tensor gather(const Tensor& x, int64_t dimension, const Tensor& places) {
  require(x.dimensions() == 1 && places.dimensions() == 1 && x.place_of(dimension) == 0,
          "gather takes vectors");
  return taken(x, 0, places);
}

inline std::pair<Tensor, Tensor> topk(const Tensor& x, int64_t k) {
  require(x.dimensions() == 1 && k <= x.size(0), "topk takes a vector of at least k elements");
  const Tensor values = contiguous(x);
  const double* v = values.data();
  std::vector<int64_t> order(static_cast<size_t>(x.size(0)));
  for (size_t i = 0; i < order.size(); ++i) order[i] = static_cast<int64_t>(i);
  // NaN counts as the largest
  std::stable_sort(order.begin(), order.end(), [v](int64_t a, int64_t b) {
    return v[a] != v[a] ? v[b] == v[b] : v[a] > v[b];
  });
  Tensor places = Tensor::empty(Integers{k}, Kind::kInteger);
  for (int64_t i = 0; i < k; ++i) places.data()[i] = static_cast<double>(order[i]);
  return {taken(values, 0, places), places};
}

inline Integers tolist(const Tensor& x) {
  require(x.dimensions() == 1, "a list is made of a vector");
  Integers values;
  for (int64_t k = 0; k < x.size(0); ++k)
    values.append(static_cast<int64_t>(x.data()[k * x.stride(0)]));
  return values;
}

// ---- reductions

// A result without `dimensions` (all, if none), or with 1 in their places; and the same memory as a
// view that has the sizes of x.
inline std::pair<Tensor, Tensor> beside(const Tensor& x, const Integers& dimensions, bool keep,
                                        Kind kind, double start) {
  bool gone[kMostDimensions] = {};
  if (dimensions.count() == 0) std::fill(gone, gone + kMostDimensions, true);
  for (int64_t d : dimensions) gone[x.place_of(d)] = true;
  Integers sizes;
  for (int d = 0; d < x.dimensions(); ++d)
    if (!gone[d] || keep) sizes.append(gone[d] ? 1 : x.size(d));
  Tensor out = full(sizes, start, kind), wide = out.bare();
  for (int d = 0, own = 0; d < x.dimensions(); ++d) {
    wide.add_dimension(x.size(d), gone[d] ? 0 : out.stride(own));
    own += keep || !gone[d];
  }
  return {out, wide};
}

// Loops over `dimensions` (all, if none), which are gone or 1 in the result.
template <class F>
inline Tensor reduced(const Tensor& x, const Integers& dimensions, bool keep, Kind kind,
                      double start, F f) {
  const auto [out, wide] = beside(x, dimensions, keep, kind, start);
  update(wide, x, f);
  return out;
}

inline Tensor sum(const Tensor& x, const Integers& dimensions = {}, bool keep = false) {
  const Kind kind = std::max(x.kind(), Kind::kInteger);
  return reduced(x, dimensions, keep, kind, 0.0, [](double a, double b) { return a + b; });
}
// A product that is summed and nothing else: it takes no memory.
struct Product {
  const Tensor &a, &b;
};
inline Tensor sum(const Product& x, const Integers& dimensions = {}, bool keep = false) {
  const Tensor &a = x.a, &b = x.b;
  const Kind kind = promoted(a, b);
  if (kind != Kind::kReal) return sum(mul(a, b), dimensions, keep);
  const Integers sizes = common_sizes({&a, &b});
  const auto [out, wide] = beside(expand(a, sizes), dimensions, keep, kind, 0.0);
  update(wide, a, b, [](double total, double p, double q) { return total + p * q; });
  return out;
}
inline Tensor mean(const Tensor& x, const Integers& dimensions = {}, bool keep = false) {
  Tensor total = sum(x, dimensions, keep);
  return div(total, static_cast<double>(x.count()) / static_cast<double>(total.count()));
}
inline Tensor amax(const Tensor& x, const Integers& dimensions, bool keep) {
  return reduced(x, dimensions, keep, x.kind(), -elementary::kInfinity,
                 [](double a, double b) { return a > b || a != a ? a : b; });
}
inline Tensor amin(const Tensor& x, const Integers& dimensions, bool keep) {
  return reduced(x, dimensions, keep, x.kind(), elementary::kInfinity,
                 [](double a, double b) { return a < b || a != a ? a : b; });
}
inline Tensor any(const Tensor& x, const Integers& dimensions = {}, bool keep = false) {
  return reduced(x, dimensions, keep, Kind::kBoolean, 0.0,
                 [](double a, double b) { return a != 0.0 || b != 0.0 ? 1.0 : 0.0; });
}
inline Tensor all(const Tensor& x, const Integers& dimensions = {}, bool keep = false) {
  return reduced(x, dimensions, keep, Kind::kBoolean, 1.0,
                 [](double a, double b) { return a != 0.0 && b != 0.0 ? 1.0 : 0.0; });
}

inline Tensor argmax(const Tensor& x, Place dimension) {
  require(!dimension || x.dimensions() == 1, "argmax takes a vector");
  const Tensor values = contiguous(x);
  const double* v = values.data();
  int64_t best = 0;
  for (int64_t k = 1; k < values.count() && v[best] == v[best]; ++k)
    if (v[k] > v[best] || v[k] != v[k]) best = k;
  return Tensor::of(best);
}

inline Tensor softmax(const Tensor& x, int64_t dimension) {
  const Tensor shifted = exp(sub(x, amax(x, {dimension}, true)));
  return div(shifted, sum(shifted, {dimension}, true));
}
inline Tensor log_softmax(const Tensor& x, int64_t dimension) {
  const Tensor shifted = sub(x, amax(x, {dimension}, true));
  return sub(shifted, log(sum(exp(shifted), {dimension}, true)));
}

// ---- products

inline Tensor matmul(const Tensor& a, const Tensor& b) {
  const bool row = a.dimensions() == 1, column = b.dimensions() == 1;
  const Tensor left = row ? unsqueeze(a, 0) : a, right = column ? unsqueeze(b, 1) : b;
  const int p = left.dimensions(), q = right.dimensions();
  const int64_t m = left.size(p - 2), k = left.size(p - 1), n = right.size(q - 1);
  require(right.size(q - 2) == k, "the sizes of factors do not fit");
  Integers sizes;
  const int batch = std::max(p, q) - 2;
  for (int d = 0; d < batch; ++d) {
    const int x = d - (batch - p + 2), y = d - (batch - q + 2);
    const int64_t u = x < 0 ? 1 : left.size(x), v = y < 0 ? 1 : right.size(y);
    require(u == v || u == 1 || v == 1, "the sizes of factors do not fit");
    sizes.append(u == 1 ? v : u);
  }
  Integers all = sizes;
  if (!row) all.append(m);
  if (!column) all.append(n);
  Tensor out = Tensor::empty(all, std::max(a.kind(), b.kind()));
  Loop<3> loop;
  loop.data[0] = out.data();
  loop.data[1] = left.data();
  loop.data[2] = right.data();
  int64_t stride = m * n, strides[kMostDimensions];
  for (int d = batch - 1; d >= 0; --d) {
    strides[d] = stride;
    stride *= sizes[d];
  }
  for (int d = 0; d < batch; ++d) {
    const int x = d - (batch - p + 2), y = d - (batch - q + 2);
    loop.add(sizes[d], {strides[d], x < 0 || left.size(x) == 1 ? 0 : left.stride(x),
                        y < 0 || right.size(y) == 1 ? 0 : right.stride(y)});
  }
  const int64_t am = left.stride(p - 2), ak = left.stride(p - 1);
  const int64_t bk = right.stride(q - 2), bn = right.stride(q - 1);
  const bool by_columns = bn != 1 && n > 1;
  Shared<Storage> rows;
  if (by_columns) rows = Storage::of(k * n);
  loop.run([&](int64_t count, double** x, const int64_t* s) {
    // matrices one below the other with one factor are one matrix
    const bool joins = s[2] == 0 && s[1] == m * am && s[0] == m * n;
    const int64_t times = joins ? 1 : count, height = joins ? m * count : m;
    for (int64_t h = 0; h < times; ++h) {
      const double* b = x[2] + h * s[2];
      if (by_columns) {
        double* to = rows->data();
        for (int64_t l = 0; l < k; ++l)
          for (int64_t j = 0; j < n; ++j) to[l * n + j] = b[l * bk + j * bn];
        b = to;
      }
      detail::multiply(x[1] + h * s[1], am, ak, b, by_columns ? n : bk, x[0] + h * s[0], height, k,
                       n);
    }
  });
  return out;
}

// The transpose of a constant in rows, made once.
inline const Tensor& by_rows(const Tensor& constant) {
  static std::vector<std::pair<Tensor, Tensor>> known;
  for (const auto& [key, rows] : known)
    if (key.data() == constant.data()) return rows;
  known.emplace_back(constant, contiguous(transpose(constant, 0, 1)));
  return known.back().second;
}

// x W' + b of a constant W
inline Tensor linear(const Tensor& x, const Tensor& weight, const Tensor& bias) {
  const Tensor product = matmul(x, by_rows(weight));
  return bias.defined() ? add(product, bias) : product;
}

inline Tensor dot(const Tensor& a, const Tensor& b) { return matmul(a, b); }
inline Tensor mv(const Tensor& a, const Tensor& b) { return matmul(a, b); }

// ---- triangular factors

namespace detail {

// L of A = L L' in place, of `count` systems [n, n], and the order of the first minor of each that
// is not positive, 0 where all are.
inline void factorise_all(double* factor, double* info, int64_t count, int64_t n) {
  const Shared<Storage> room = Storage::of(kLanes * n * n);
  auto* l = reinterpret_cast<Lanes*>(room->data());
  for (int64_t h = 0; h < count; h += kLanes) {
    double* own = factor + h * n * n;
    gather(l, own, n * n, count - h, n * n);
    const bool all = factorise(l, n);
    if (all) scatter(own, l, n * n, count - h, n * n);
    for (int64_t t = 0; t < std::min(count - h, kLanes); ++t)
      info[h + t] = all ? 0.0 : static_cast<double>(factorise(own + t * n * n, n));
  }
  for (int64_t row = 0; row < count * n; ++row)
    std::fill(factor + row * n + row % n + 1, factor + (row + 1) * n, 0.0);
}

// Solves L X = B, or L L' X = B, in place: `count` systems [n, m] whose factors are `step` apart.
inline void solve_all(const double* factor, int64_t step, double* x, int64_t count, int64_t n,
                      int64_t m, bool both) {
  const Shared<Storage> room = Storage::of(kLanes * n * (n + m));
  auto* left = reinterpret_cast<Lanes*>(room->data());
  Lanes* right = left + n * n;
  for (int64_t h = 0; h < count; h += kLanes) {
    gather(left, factor + h * step, step, count - h, n * n);
    gather(right, x + h * n * m, n * m, count - h, n * m);
    solve(left, right, n, m, both);
    scatter(x + h * n * m, right, n * m, count - h, n * m);
  }
}

}  // namespace detail

// L of A = L L' and the order of the first minor that is not positive, 0 where all are.
inline std::pair<Tensor, Tensor> linalg_cholesky_ex(const Tensor& x) {
  const int p = x.dimensions();
  const int64_t n = x.size(p - 1);
  Integers batch;
  for (int d = 0; d < p - 2; ++d) batch.append(x.size(d));
  Tensor factor = Tensor::empty_like(x, x.kind());
  copy_into(factor, x);
  Tensor info = Tensor::empty(batch, Kind::kInteger);
  detail::factorise_all(factor.data(), info.data(), n ? x.count() / (n * n) : 0, n);
  return {factor, info};
}

namespace detail {

// Runs one of both, or both, on B [..., n, m] with factors [..., n, n], broadcast.
inline Tensor solved(const Tensor& factor, const Tensor& b, bool both) {
  const int p = factor.dimensions(), q = b.dimensions();
  const int64_t n = factor.size(p - 1), m = b.size(q - 1);
  require(b.size(q - 2) == n, "the sizes of a system do not fit");
  const int batch = std::max(p, q) - 2;
  Integers sizes, whole;
  for (int d = 0; d < batch; ++d) {
    const int x = d - (batch - p + 2), y = d - (batch - q + 2);
    const int64_t u = x < 0 ? 1 : factor.size(x), v = y < 0 ? 1 : b.size(y);
    sizes.append(u == 1 ? v : u);
    whole.append(sizes[d]);
  }
  Integers of_factor = sizes;
  of_factor.append(n);
  of_factor.append(n);
  whole.append(n);
  whole.append(m);
  Tensor out = Tensor::empty(whole, b.kind());
  copy_into(out, expand(b, whole));
  const Tensor l = contiguous(p == 2 ? factor : expand(factor, of_factor));
  const int64_t count = n && m ? out.count() / (n * m) : 0;
  solve_all(l.data(), p == 2 ? 0 : n * n, out.data(), count, n, m, both);
  return out;
}

}  // namespace detail

inline Tensor cholesky_solve(const Tensor& b, const Tensor& factor) {
  return detail::solved(factor, b, true);
}
inline Tensor linalg_solve_triangular(const Tensor& factor, const Tensor& b) {
  return detail::solved(factor, b, false);
}
inline Tensor cholesky_inverse(const Tensor& factor) {
  const int64_t n = factor.size(factor.dimensions() - 1);
  return detail::solved(factor, eye(n, n, factor.kind()), true);
}

// ---- lists of integers

inline Integers joined(const Integers& a, const Integers& b) {
  Integers both = a;
  for (int64_t value : b) both.append(value);
  return both;
}
inline Integers repeated(const Integers& a, int64_t times) {
  Integers all;
  for (int64_t k = 0; k < times; ++k)
    for (int64_t value : a) all.append(value);
  return all;
}
template <class Items>
Items part(const Items& a, Place start, Place end, int64_t step) {
  const int64_t n = a.count();
  const auto inside = [n](int64_t place) {
    return std::clamp(place < 0 ? place + n : place, int64_t{0}, n);
  };
  Items some;
  for (int64_t k = inside(start.value_or(0)); k < inside(end.value_or(n)); k += step)
    some.append(a[k]);
  return some;
}
inline int64_t occurrences(const Integers& a, int64_t value) {
  return std::count(a.begin(), a.end(), value);
}

}  // namespace terrain
