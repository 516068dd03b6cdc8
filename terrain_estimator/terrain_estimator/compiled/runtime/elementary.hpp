// SPDX-FileCopyrightText: 2026 The terrain_estimator authors
// SPDX-License-Identifier: Apache-2.0
//
// Elementary functions in plain IEEE arithmetic, so that every processor gives the same bytes.
//
// A C library's exp or sin differs from one version and processor to the next in the last place.
// These are accurate to about 2e-15 (relative; sin and cos: absolute) on |x| < 1e6. They have no
// branches on values, so that a compiler can take several at once. Compile with -ffp-contract=off.
// The method is the usual one: reduce the argument, then a power series that is exact to rounding.

#pragma once

#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>

#ifndef __GNUC__
#error "compile with GCC or Clang: the runtime uses their attributes and vector types"
#endif

// In a loop, so that it takes several at once.
#define TERRAIN_INLINE inline __attribute__((always_inline))
// The same for the body of a loop.
#define TERRAIN_INNER __attribute__((always_inline))

namespace terrain::elementary {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
// 1.5 * 2^52: adding it leaves the nearest integer in the low bits of the sum.
constexpr double kRounder = 6755399441055744.0;
// ln 2 and pi / 2 in pieces whose products with a small integer are exact.
constexpr double kLn2High = 0x1.62e42fefa38p-1, kLn2Low = 0x1.ef35793c7673p-45;
constexpr double kHalfPiHigh = 0x1.921fb544p+0, kHalfPiMid = 0x1.0b4611a6p-34;
constexpr double kHalfPiLow = 0x1.3198a2e037073p-69;
constexpr double kHalfPi = 0x1.921fb54442d18p+0;

TERRAIN_INLINE uint64_t bits(double x) {
  uint64_t b;
  std::memcpy(&b, &x, 8);
  return b;
}

TERRAIN_INLINE double of_bits(uint64_t b) {
  double x;
  std::memcpy(&x, &b, 8);
  return x;
}

// 2^k of an integer k in -1022 ... 1023
TERRAIN_INLINE double power_of_two(double k) { return of_bits((bits(k + kRounder) + 1023) << 52); }

// exp(r) - 1 for |r| <= ln(2) / 2
TERRAIN_INLINE double expm1_near_zero(double r) {
  double p = 1.0 / 6227020800.0;
  p = p * r + 1.0 / 479001600.0;
  p = p * r + 1.0 / 39916800.0;
  p = p * r + 1.0 / 3628800.0;
  p = p * r + 1.0 / 362880.0;
  p = p * r + 1.0 / 40320.0;
  p = p * r + 1.0 / 5040.0;
  p = p * r + 1.0 / 720.0;
  p = p * r + 1.0 / 120.0;
  p = p * r + 1.0 / 24.0;
  p = p * r + 1.0 / 6.0;
  p = p * r + 0.5;
  return r + (r * r) * p;
}

TERRAIN_INLINE double exp(double x) {
  const double inside = x < -746.0 ? -746.0 : (x > 710.0 ? 710.0 : x);
  const double k = (inside * 1.4426950408889634 + kRounder) - kRounder;
  const double r = (inside - k * kLn2High) - k * kLn2Low;
  const double half = (0.5 * k + kRounder) - kRounder;  // 2^k in two steps, for tiny results
  return (1.0 + expm1_near_zero(r)) * power_of_two(half) * power_of_two(k - half);
}

// exp(x) for -700 <= x <= 700, whose results are normal
TERRAIN_INLINE double exp_of_moderate(double x) {
  const double k = (x * 1.4426950408889634 + kRounder) - kRounder;
  const double r = (x - k * kLn2High) - k * kLn2Low;
  return (1.0 + expm1_near_zero(r)) * power_of_two(k);
}

// expm1(x) for -60 <= x <= 700
TERRAIN_INLINE double expm1_of_moderate(double x) {
  const double k = (x * 1.4426950408889634 + kRounder) - kRounder;
  const double r = (x - k * kLn2High) - k * kLn2Low;
  const double scale = power_of_two(k);
  return scale * expm1_near_zero(r) + (scale - 1.0);
}

TERRAIN_INLINE double expm1(double x) {
  const double inside = x < -60.0 ? -60.0 : (x > 700.0 ? 700.0 : x);
  return x > 700.0 ? exp(x) : expm1_of_moderate(inside);
}

// log(x 2^-less) of a normal x > 0
TERRAIN_INLINE double log_of_normal(double x, double less = 0.0) {
  const uint64_t whole = bits(x);
  const uint64_t shifted = whole + (0x3ff0000000000000ull - 0x3fe6a09e667f3bcdull);
  const uint64_t exponent = shifted >> 52;
  const double e =
      (of_bits(exponent | 0x4330000000000000ull) - 4503599627370496.0) - 1023.0 - less;
  // in sqrt(1/2) ... sqrt(2)
  const double f = of_bits(whole - ((exponent - 1023) << 52)) - 1.0;
  const double s = f / (2.0 + f), z = s * s, half = 0.5 * f * f;
  double p = 2.0 / 25.0;
  p = p * z + 2.0 / 23.0;
  p = p * z + 2.0 / 21.0;
  p = p * z + 2.0 / 19.0;
  p = p * z + 2.0 / 17.0;
  p = p * z + 2.0 / 15.0;
  p = p * z + 2.0 / 13.0;
  p = p * z + 2.0 / 11.0;
  p = p * z + 2.0 / 9.0;
  p = p * z + 2.0 / 7.0;
  p = p * z + 2.0 / 5.0;
  p = p * z + 2.0 / 3.0;
  return e * kLn2High + (f - (half - (s * (half + z * p) + e * kLn2Low)));
}

TERRAIN_INLINE double log(double x) {
  const bool tiny = x < 2.2250738585072014e-308;
  const double near = log_of_normal(tiny ? x * 18014398509481984.0 : x, tiny ? 54.0 : 0.0);
  const double positive = x == kInfinity ? kInfinity : near;
  return x > 0.0 ? positive : (x == 0.0 ? -kInfinity : kNaN);
}

TERRAIN_INLINE double pow(double x, double y) {
  const double size = std::fabs(x), half = 0.5 * y;
  const double power = y == 0.0 ? 1.0 : exp(y * log(size));
  const bool whole = (y + kRounder) - kRounder == y, even = (half + kRounder) - kRounder == half;
  const double of_negative = whole ? (even ? power : -power) : (size == kInfinity ? power : kNaN);
  return x >= 0.0 || y == 0.0 ? power : of_negative;
}

// sin(r) and cos(r) for |r| <= pi / 4
TERRAIN_INLINE double sin_near_zero(double r) {
  const double z = r * r;
  double s = 1.0 / 355687428096000.0;
  s = s * z - 1.0 / 1307674368000.0;
  s = s * z + 1.0 / 6227020800.0;
  s = s * z - 1.0 / 39916800.0;
  s = s * z + 1.0 / 362880.0;
  s = s * z - 1.0 / 5040.0;
  s = s * z + 1.0 / 120.0;
  s = s * z - 1.0 / 6.0;
  return r + r * z * s;
}
TERRAIN_INLINE double cos_near_zero(double r) {
  const double z = r * r;
  double c = -1.0 / 6402373705728000.0;
  c = c * z + 1.0 / 20922789888000.0;
  c = c * z - 1.0 / 87178291200.0;
  c = c * z + 1.0 / 479001600.0;
  c = c * z - 1.0 / 3628800.0;
  c = c * z + 1.0 / 40320.0;
  c = c * z - 1.0 / 720.0;
  c = c * z + 1.0 / 24.0;
  return 1.0 - (0.5 * z - z * z * c);
}

// sin (quarter = 0) and cos (quarter = 1)
TERRAIN_INLINE double sin_from(double x, double quarter) {
  const double k = (x * 0.63661977236758134 + kRounder) - kRounder;
  const double r = ((x - k * kHalfPiHigh) - k * kHalfPiMid) - k * kHalfPiLow;
  // the quarter turn modulo 4, by exact sums of doubles
  const double turn = k + quarter;
  const double odd = std::fabs(turn - 2.0 * ((0.5 * turn + kRounder) - kRounder));
  const double pair = 0.5 * (turn - odd);
  const double back = pair - 2.0 * ((0.5 * pair + kRounder) - kRounder);
  const double value = odd != 0.0 ? cos_near_zero(r) : sin_near_zero(r);
  const double turned = back != 0.0 ? -value : value;
  return std::fabs(x) < 1e9 ? turned : kNaN;
}

TERRAIN_INLINE double sin(double x) { return sin_from(x, 0.0); }
TERRAIN_INLINE double cos(double x) { return sin_from(x, 1.0); }

// atan(t) for |t| <= tan(pi / 16)
TERRAIN_INLINE double atan_near_zero(double t) {
  const double z = t * t;
  double p = -1.0 / 27.0;
  p = p * z + 1.0 / 25.0;
  p = p * z - 1.0 / 23.0;
  p = p * z + 1.0 / 21.0;
  p = p * z - 1.0 / 19.0;
  p = p * z + 1.0 / 17.0;
  p = p * z - 1.0 / 15.0;
  p = p * z + 1.0 / 13.0;
  p = p * z - 1.0 / 11.0;
  p = p * z + 1.0 / 9.0;
  p = p * z - 1.0 / 7.0;
  p = p * z + 1.0 / 5.0;
  p = p * z - 1.0 / 3.0;
  return t + t * z * p;
}

// the angle is halved three times, by tan(a / 2) = sin a / (1 + cos a)
TERRAIN_INLINE double asin(double x) {
  double t = x / (1.0 + std::sqrt((1.0 - x) * (1.0 + x)));
  t = t / (1.0 + std::sqrt(1.0 + t * t));
  t = t / (1.0 + std::sqrt(1.0 + t * t));
  return 8.0 * atan_near_zero(t);
}

// the angle of the smaller over the larger side is halved twice, then set into its quarter
TERRAIN_INLINE double atan2(double y, double x) {
  const double up = std::fabs(y), along = std::fabs(x);
  const double small = up < along ? up : along, large = up < along ? along : up;
  double t = small / (large > 0.0 ? large : 1.0);
  t = small == kInfinity ? 1.0 : t;
  t = t / (1.0 + std::sqrt(1.0 + t * t));
  t = t / (1.0 + std::sqrt(1.0 + t * t));
  const double angle = 4.0 * atan_near_zero(t);
  const double acute = up > along ? kHalfPi - angle : angle;
  const double positive = std::signbit(x) ? 2.0 * kHalfPi - acute : acute;
  return x != x || y != y ? kNaN : std::copysign(positive, y);
}

TERRAIN_INLINE double tanh(double x) {
  const double size = std::fabs(x), e = expm1_of_moderate(2.0 * (size < 20.0 ? size : 20.0));
  const double value = x != x ? x : e / (e + 2.0);
  return x < 0.0 ? -value : value;
}

// Series of erf below 2.5, continued fraction of erfc beyond (Abramowitz and Stegun 7.1.6, 7.1.14).
inline double erfc(double x) {
  if (x != x) return x;
  const double size = std::fabs(x), square = size * size;
  double tail;
  if (size < 2.5) {
    double term = size, sum = size;
    for (int n = 1; n < 60; ++n) {
      term *= 2.0 * square / (2 * n + 1);
      sum += term;
    }
    tail = 1.0 - 1.1283791670955126 * exp(-square) * sum;
  } else {
    double fraction = size;
    for (int n = 80; n > 0; --n) fraction = size + 0.5 * n / fraction;
    tail = size > 27.5 ? 0.0 : 0.56418958354775629 * exp(-square) / fraction;
  }
  return x < 0.0 ? 2.0 - tail : tail;
}

// Stirling's series above 10, by recurrence below (Abramowitz and Stegun 6.1.15, 6.1.41); x > 0
inline double log_gamma(double x) {
  double product = 1.0;
  while (x < 10.0) {
    product *= x;
    x += 1.0;
  }
  const double z = 1.0 / (x * x);
  double p = 1.0 / 156.0;
  p = p * z - 691.0 / 360360.0;
  p = p * z + 1.0 / 1188.0;
  p = p * z - 1.0 / 1680.0;
  p = p * z + 1.0 / 1260.0;
  p = p * z - 1.0 / 360.0;
  p = p * z + 1.0 / 12.0;
  return (x - 0.5) * log(x) - x + 0.91893853320467274 + p / x - log(product);
}

// Regularised lower incomplete gamma function P(a, x): its series below a + 1, the continued
// fraction of 1 - P beyond (Abramowitz and Stegun 6.5.29, 6.5.31).
inline double igamma(double a, double x) {
  if (!(a > 0.0) || !(x >= 0.0)) return kNaN;
  if (a == kInfinity) return x == kInfinity ? kNaN : 0.0;
  if (x == 0.0) return 0.0;
  if (x == kInfinity) return 1.0;
  const double front = exp(a * log(x) - x - log_gamma(a));
  if (x < a + 1.0) {
    double term = 1.0 / a, sum = term;
    for (int n = 1; n < 2000 && term > 1e-17 * sum; ++n) {
      term *= x / (a + n);
      sum += term;
    }
    return front * sum;
  }
  // Lentz's method in the form without zero denominators
  double b = x + 1.0 - a, c = 1e300, d = 1.0 / b, h = d;
  for (int n = 1; n < 2000; ++n) {
    const double an = -n * (n - a);
    b += 2.0;
    d = 1.0 / (an * d + b);
    c = b + an / c;
    const double step = d * c;
    h *= step;
    if (std::fabs(step - 1.0) < 1e-16) break;
  }
  return 1.0 - front * h;
}

}  // namespace terrain::elementary
