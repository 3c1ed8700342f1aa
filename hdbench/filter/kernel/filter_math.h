/* Sines and exponentials without a library. */
#ifndef HDBENCH_FILTER_MATH_H
#define HDBENCH_FILTER_MATH_H

#include <float.h>
#include <math.h>

#include "filter.h"

#if defined(__GNUC__)
#define HDB_INLINE static inline __attribute__((always_inline))
#elif defined(_MSC_VER)
#define HDB_INLINE static __forceinline
#else
#define HDB_INLINE static inline
#endif

#ifdef __GNUC__
#define HDB_COLD static __attribute__((noinline, cold))
#define HDB_APART static __attribute__((noinline))
#else
#define HDB_COLD static
#define HDB_APART static
#endif

#ifdef __GNUC__
#define HDB_UNROLL _Pragma("GCC unroll 16") /* small counts, fixed when inlined */
#else
#define HDB_UNROLL
#endif

#ifdef HDB_N_OSCILLATORS /* counts fixed by the build */
#define HDB_UNROLL_FIXED HDB_UNROLL
#else
#define HDB_UNROLL_FIXED
#endif

#ifdef HDB_SINGLE
typedef uint32_t hdb_bits;
#else
typedef uint64_t hdb_bits;
#endif
#define K(value) ((hdb_real)(value)) /* a constant in the precision of the build */
#define HDB_NAN K(NAN)

/* Angles up to HDB_REDUCIBLE: quarter turns k are taken off as products k * part that are exact.
 * A phase beyond HDB_PHASE_LIMIT loses its whole turns: rounding stays below 4e-15 rad (2e-7). */
#ifdef HDB_SINGLE
#define HDB_LARGEST FLT_MAX
#define HDB_SIGN 30 /* moves bit 1 to the sign */
#define HDB_BIAS 0x1.8p23f /* added and taken off, it leaves the nearest integer */
#define HDB_REDUCIBLE 200.0f /* rad: k stays below 2^7 */
#define HDB_PHASE_LIMIT 3.2f
#else
#define HDB_LARGEST DBL_MAX
#define HDB_SIGN 62
#define HDB_BIAS 0x1.8p52
#define HDB_REDUCIBLE 1e5 /* rad: k stays below 2^16 */
#define HDB_PHASE_LIMIT 32.0
#endif

HDB_INLINE hdb_real hdb_abs(hdb_real value)
{
#if defined(__GNUC__) && defined(HDB_SINGLE)
    return __builtin_fabsf(value);
#elif defined(__GNUC__)
    return __builtin_fabs(value);
#else
    return value < 0 ? -value : value;
#endif
}

/* NaN-proof: false for NaN. */
HDB_INLINE int hdb_usable(hdb_real value) { return hdb_abs(value) <= K(HDB_USABLE); }

/* An angle less its whole turns. */
HDB_INLINE hdb_real hdb_less_turns(hdb_real a)
{
    const hdb_real n = (a * K(0x1.45f306dc9c883p-3) + HDB_BIAS) - HDB_BIAS;
#ifdef HDB_SINGLE
    return ((a - n * 0x1.92p2f) - n * 0x1.fb54p-10f) - n * 0x1.10b46p-28f;
#else
    return (a - n * 0x1.921fb5440p2) - n * 0x1.0b4611a60p-32;
#endif
}

/* The turn of one sample, within HDB_PHASE_LIMIT; 0 where it is not finite. */
HDB_INLINE hdb_real hdb_turn_within(hdb_real a)
{
    if (hdb_abs(a) <= HDB_PHASE_LIMIT)
        return a;
    if (hdb_abs(a) <= HDB_REDUCIBLE)
        return hdb_less_turns(a);
#ifdef HDB_SINGLE
    const float turns = a * 0x1.45f306p-3f; /* a float this large has lost its phase already */
    const float whole = (turns + HDB_BIAS) - HDB_BIAS;
    return hdb_abs(turns) <= 0x1p21f ? (turns - whole) * 0x1.921fb6p2f : 0.0f;
#else
    return hdb_abs(a) <= HDB_LARGEST ? atan2(sin(a), cos(a)) : 0.0;
#endif
}

/* The oscillator before j that turns through half its angle, or -1. */
HDB_INLINE int hdb_half(const hdb_model *model, int j)
{
    int found = -1;
    HDB_UNROLL_FIXED
    for (int m = 0; m < j; ++m) {
        const hdb_real twice = K(2.0) * model->block[m].order, order = model->block[j].order;
        if (order > 0 && !(order < twice || order > twice))
            found = m;
    }
    return found;
}

/* 1 - exp(-a), a >= 0, by its series on [0, 1/4] and doublings. */
HDB_INLINE hdb_real hdb_decay(hdb_real a)
{
    int doublings = 0;
    if (!(a < K(64.0)))
        a = K(64.0);
    for (; a > K(0.25); ++doublings)
        a *= K(0.5);
    hdb_real total = K(1.0);
    HDB_UNROLL
    for (int k = 14; k > 1; --k)
        total = K(1.0) - a * (K(1.0) / (hdb_real)k) * total;
    hdb_real missing = a * total;
    for (; doublings > 0; --doublings)
        missing = missing * (K(2.0) - missing);
    return missing;
}

/* 6 (exp(b) - 1 - b - b^2/2) / b^3, 0 <= b <= 1/2. */
HDB_INLINE hdb_real hdb_tail(hdb_real b)
{
    hdb_real total = K(1.0);
    HDB_UNROLL
    for (int k = 16; k > 3; --k)
        total = K(1.0) + b * (K(1.0) / (hdb_real)k) * total;
    return total;
}

#define HDB_SINCOS hdb_sincos
#define HDB_SINCOS_BITS hdb_sincos_bits
#define HDB_NUMBER hdb_real
#define HDB_WORD hdb_bits
#include "filter_sincos.h"

/* Transition and process noise of a slow torque over dt: f11 f12 f21 f22 q11 q12 q22. */
HDB_INLINE void hdb_slow(const hdb_block *b, hdb_real dt, hdb_real f[7])
{
    const hdb_real a = b->rate * dt;
    f[1] = f[2] = f[3] = f[5] = f[6] = 0;
    if (b->kind == HDB_RANDOM_WALK) {
        f[0] = 1;
        f[4] = b->q_sample + b->q_s * dt;
    } else if (b->kind == HDB_INTEGRATED_WALK) {
        const hdb_real q = b->q_s * dt;
        f[0] = f[3] = 1;
        f[1] = dt;
        f[4] = q * dt * dt * K(1.0 / 3.0);
        f[5] = q * dt * K(0.5);
        f[6] = q;
    } else if (b->kind == HDB_ORNSTEIN_UHLENBECK) {
        const hdb_real missing = hdb_decay(a), e = K(1.0) - missing;
        f[0] = e;
        f[4] = b->variance * (missing * (K(1.0) + e));
    } else if (b->kind == HDB_RESONANCE) { /* w = order: e [c + z s, s; -omega^2 s, c - z s] */
        const hdb_real missing = hdb_decay(K(2.0) * a), e = K(1.0) - hdb_decay(a);
        const hdb_real w2 = b->omega * b->omega;
        hdb_real s, c;
        hdb_sincos(hdb_turn_within(b->order * dt), &s, &c);
        s = s / b->order;
        const hdb_real zs = b->rate * s, pull = K(2.0) * zs * (K(1.0) - missing);
        const hdb_real q1 = missing - pull * (c + zs);
        f[0] = e * (c + zs);
        f[1] = e * s;
        f[2] = -(w2 * (e * s));
        f[3] = e * (c - zs);
        f[4] = b->variance * (q1 > 0 ? q1 : 0);
        f[5] = b->variance * w2 * (pull * s);
        f[6] = b->variance * w2 * (missing + pull * (c - zs));
    } else {
        const hdb_real e = K(1.0) - hdb_decay(a), c = K(2.0) * a, ec = K(1.0) - hdb_decay(c);
        const hdb_real third = c * c * c * K(1.0 / 6.0) * hdb_tail(c <= K(0.5) ? c : K(0.5));
        const hdb_real f1 =
            c <= K(0.5) ? ec * third : K(1.0) - ec * (K(1.0) + c + K(0.5) * c * c);
        f[0] = e * (K(1.0) + a);
        f[1] = e * dt;
        f[2] = -(b->rate * a * e);
        f[3] = e * (K(1.0) - a);
        f[4] = b->variance * f1;
        f[5] = b->variance * b->rate * (K(2.0) * a * a * ec);
        f[6] = b->variance * b->rate * b->rate * (K(2.0) * c * ec + f1);
    }
}

#endif
