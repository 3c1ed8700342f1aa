/* Sine and cosine. A template: define before each inclusion HDB_SINCOS, its name, and HDB_NUMBER and
 * HDB_WORD, the number and the unsigned integer of its size, of one lane or of many. */
typedef union {
    HDB_NUMBER value;
    HDB_WORD as_word;
} HDB_SINCOS_BITS;

/* Sine and cosine by Taylor polynomials on [-pi/4, pi/4]; first omitted terms below 5e-17 (3e-8).
 * The double form lacks 2.0e-21 of pi/2, so r is off by 1.3e-16 at most. */
HDB_INLINE void HDB_SINCOS(HDB_NUMBER a, HDB_NUMBER *sine, HDB_NUMBER *cosine)
{
    const HDB_NUMBER biased = a * K(0x1.45f306dc9c883p-1) + HDB_BIAS, k = biased - HDB_BIAS;
#ifdef HDB_SINGLE
    const HDB_NUMBER r = ((a - k * 0x1.92p0f) - k * 0x1.fb54p-12f) - k * 0x1.10b46p-30f, z = r * r;
    HDB_NUMBER s = z * K(1.0 / 362880.0) - K(1.0 / 5040.0), c = z * K(1.0 / 40320.0);
#else
    const HDB_NUMBER r = (a - k * 0x1.921fb5440p0) - k * 0x1.0b4611a60p-34, z = r * r;
    HDB_NUMBER s = z * (-1.0 / 1307674368000.0) + 1.0 / 6227020800.0;
    s = s * z - 1.0 / 39916800.0;
    s = s * z + 1.0 / 362880.0;
    s = s * z - 1.0 / 5040.0;
    HDB_NUMBER c = z * (1.0 / 20922789888000.0) - 1.0 / 87178291200.0;
    c = c * z + 1.0 / 479001600.0;
    c = c * z - 1.0 / 3628800.0;
    c = (c * z + 1.0 / 40320.0) * z;
#endif
    s = s * z + K(1.0 / 120.0);
    s = s * z - K(1.0 / 6.0);
    c = c - K(1.0 / 720.0);
    c = c * z + K(1.0 / 24.0);
    s = r + r * (z * s);
    c = K(1.0) + (z * z * c - K(0.5) * z);
    /* quarter turn k mod 4, from the last two bits of biased: change places, and signs */
    HDB_SINCOS_BITS turns = {biased}, up = {s}, along = {c};
    const HDB_WORD swap = (up.as_word ^ along.as_word) & -(turns.as_word & 1);
    up.as_word ^= swap ^ ((turns.as_word & 2) << HDB_SIGN);
    along.as_word ^= swap ^ (((turns.as_word + 1) & 2) << HDB_SIGN);
    *sine = up.value;
    *cosine = along.value;
}

#undef HDB_SINCOS
#undef HDB_SINCOS_BITS
#undef HDB_NUMBER
#undef HDB_WORD
