/* P of six states in two registers of AVX-512, each number once but for (1, 0): what a measurement
 * takes off costs less than with rows. Part of the template of filter_rows.h; the same expressions.
 * First register: 23 01 02 03 04 05 24 25, second: 10 34 12 13 14 15 35 45 (HDB_TRIANGLE). */

/* Row `a` times a number; 0 in lane a. */
HDB_INLINE part_of_row HDB_ROWS(row)(const filter *f, int a, int m, double by)
{
    const part_of_row all = EVERYWHERE(by), one = f->p[0][m], two = f->p[1][m];
    const __mmask8 own = f->others[a];
    const __m512i from[4] = {_mm512_setr_epi64(2, 10, 0, 0, 6, 7, 0, 0),
                             _mm512_setr_epi64(3, 11, 0, 0, 9, 14, 0, 0),
                             _mm512_setr_epi64(4, 12, 6, 9, 0, 15, 0, 0),
                             _mm512_setr_epi64(5, 13, 7, 14, 15, 0, 0, 0)};
    if (a < 2)
        return _mm512_maskz_mul_pd(own, a == 0 ? one : two, all);
    return _mm512_maskz_permutex2var_pd(own, one, from[a - 2], two) * all;
}

/* z <- z + g e / S, P <- P - g g' / S. */
HDB_INLINE void HDB_ROWS(settle)(filter *f)
{
    const part_of_row g = f->g[0];
    const __m512i one[2] = {_mm512_setr_epi64(2, 1, 2, 3, 4, 5, 2, 2),
                            _mm512_setr_epi64(0, 3, 2, 3, 4, 5, 3, 4)};
    const __m512i two[2] = {_mm512_setr_epi64(3, 0, 0, 0, 0, 0, 4, 5),
                            _mm512_setr_epi64(1, 4, 1, 1, 1, 1, 5, 5)};
    f->z[0] += g * f->step;
    f->d[0] -= f->inverse * (g * g);
    HDB_UNROLL
    for (int i = 0; i < 2; ++i)
        f->p[i][0] -= f->inverse * ((part_of_row)_mm512_permutexvar_pd(one[i], g) *
                                    (part_of_row)_mm512_permutexvar_pd(two[i], g));
}

/* C x of two x at once. */
HDB_INLINE void HDB_ROWS(both)(const part_of_row *c, const part_of_row *x, const part_of_row *y,
                               part_of_row *of_x, part_of_row *of_y)
{
    const part_of_row xc = x[0] * c[0], yc = y[0] * c[0];
    const part_of_row half = (part_of_row)_mm512_shuffle_f64x2(xc, yc, 0x44) +
                             (part_of_row)_mm512_shuffle_f64x2(xc, yc, 0xee);
    const part_of_row pair = half + HDB_MOVED(half, HDB_QUARTERS);
    const part_of_row all = pair + HDB_MOVED(pair, HDB_PAIRS);
    *of_x = _mm512_shuffle_f64x2(all, all, 0x00);
    *of_y = _mm512_shuffle_f64x2(all, all, 0xee);
}
