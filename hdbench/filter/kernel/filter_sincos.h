/* Sine and cosine. A template: define before each inclusion HDB_SINCOS, its name, and HDB_NUMBER and
 * HDB_WORD, the number and the unsigned integer of its size, of one lane or of many. */
typedef union {
    HDB_NUMBER value;
    HDB_WORD as_word;
} HDB_SINCOS_BITS;

/* Sine and cosine on [-pi/4, pi/4]. Float: Taylor polynomials, first omitted terms below 3e-8.
 * Double: those to r^15 and r^16, whose last terms are spread over the others as Chebyshev's
 * polynomial of the sixth degree in r^2 / (pi/4)^2 has it (Lanczos' economisation): 2e-17 at most.
 * The double form lacks 2.0e-21 of pi/2, so r is off by 1.3e-16 at most. */
HDB_INLINE void HDB_SINCOS(HDB_NUMBER a, HDB_NUMBER *sine, HDB_NUMBER *cosine)
{
    const HDB_NUMBER biased = a * K(0x1.45f306dc9c883p-1) + HDB_BIAS, k = biased - HDB_BIAS;
#ifdef HDB_SINGLE
    const HDB_NUMBER r = ((a - k * 0x1.92p0f) - k * 0x1.fb54p-12f) - k * 0x1.10b46p-30f, z = r * r;
    HDB_NUMBER s = z * K(1.0 / 362880.0) - K(1.0 / 5040.0), c = z * K(1.0 / 40320.0);
    s = s * z + K(1.0 / 120.0);
    s = s * z - K(1.0 / 6.0);
    c = c - K(1.0 / 720.0);
    c = c * z + K(1.0 / 24.0);
#else
    const HDB_NUMBER r = (a - k * 0x1.921fb5440p0) - k * 0x1.0b4611a60p-34, z = r * r;
    HDB_NUMBER s = z * 1.5917529185277703e-10 - 2.5051126335234744e-08;
    s = s * z + 2.755731608291509e-06;
    s = s * z - 0.0001984126983672866;
    s = s * z + 0.008333333333330932;
    s = s * z - 0.16666666666666666;
    HDB_NUMBER c = z * -1.1382298940514779e-11 + 2.087614320648874e-09;
    c = c * z - 2.755731726081664e-07;
    c = c * z + 2.4801587298749064e-05;
    c = c * z - 0.0013888888888887389;
    c = c * z + 0.041666666666666664;
#endif
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
