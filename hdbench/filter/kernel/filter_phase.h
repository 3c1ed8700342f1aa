/* Phase of every oscillator, its cosine and sine. Part of the template of filter_lanes.h. */

/* psi += turn, less whole turns beyond a limit; a float also carries what rounding left over. */
HDB_INLINE void HDB_FORM(advance)(number *psi, number *left, number turn)
{
#ifdef HDB_SINGLE
    const number more = turn + *left, sum = *psi + more;
    *left = more - (sum - *psi);
#else
    const number sum = *psi + turn;
    (void)left;
#endif
    *psi = sum;
    const mask beyond = HDB_FORM(abs)(sum) > HDB_PHASE_LIMIT;
#if HDB_LANES == 1
    if (!beyond)
        return;
#endif
    const number n = HDB_FORM(nearest)(sum * K(0x1.45f306dc9c883p-3));
#ifdef HDB_SINGLE
    *psi = ((sum - n * 0x1.92p2f) - n * 0x1.fb54p-10f) - n * 0x1.10b46p-28f;
#else
    *psi = PICK(beyond, (sum - n * 0x1.921fb5440p2) - n * 0x1.0b4611a60p-32, sum);
#endif
}

/* How far one oscillator turns from sample to sample, in k->psi. */
HDB_INLINE void HDB_FORM(turns)(int j, const hdb_block *b, int n, work *k)
{
    number *const psi = k->psi[j];
    mask far = {0};
    for (int i = 0; i < n; ++i) {
        psi[i] = b->omega > 0 ? b->omega * k->dt[i] : b->order * k->turn[i];
        far |= HDB_FORM(abs)(psi[i]) > HDB_PHASE_LIMIT;
    }
    if (ANY(far))
        for (int i = 0; i < n; ++i)
            EACH_LANE LANE(psi[i], l) = hdb_turn_within(LANE(psi[i], l));
}

#if HDB_LANES > 1
/* Phase of one oscillator at every sample, in k->psi. Whole turns are seldom due in any lane. */
HDB_INLINE void HDB_FORM(phase)(int j, lanes *s, int n, work *k)
{
    number now = s->psi[j], left = s->left[j], psi[HDB_CHUNK];
    mask beyond = {0};
    for (int i = 0; i < n; ++i) {
        psi[i] = now = now + k->psi[j][i];
        beyond |= HDB_FORM(abs)(now) > HDB_PHASE_LIMIT;
    }
    if (ANY(beyond)) {
        now = s->psi[j];
        for (int i = 0; i < n; ++i) {
            HDB_FORM(advance)(&now, &left, k->psi[j][i]);
            psi[i] = now;
        }
    }
    for (int i = 0; i < n; ++i)
        k->psi[j][i] = psi[i];
    s->psi[j] = now;
}

HDB_INLINE void HDB_FORM(phases)(int no, const int *half, lanes *s, int n, work *k)
{
    for (int j = 0; j < no; ++j)
        if (half[j] < 0)
            HDB_FORM(phase)(j, s, n, k);
}
#else
/* Phase of every oscillator at every sample, in k->psi: what each sample adds to the one before, in
 * one loop, so that the sums overlap. */
HDB_INLINE void HDB_FORM(phases)(int no, const int *half, lanes *s, int n, work *k)
{
    const number none = {0};
    number now[HDB_MAX_BLOCKS], left[HDB_MAX_BLOCKS];
    HDB_UNROLL
    for (int j = 0; j < HDB_MAX_BLOCKS; ++j) {
        now[j] = j < no ? s->psi[j] : none;
        left[j] = j < no ? s->left[j] : none;
    }
    for (int i = 0; i < n; ++i) {
        HDB_UNROLL
        for (int j = 0; j < no; ++j) {
            if (half[j] >= 0)
                continue;
            HDB_FORM(advance)(&now[j], &left[j], k->psi[j][i]);
            k->psi[j][i] = now[j];
        }
    }
    HDB_UNROLL
    for (int j = 0; j < no; ++j) {
        s->psi[j] = now[j];
        s->left[j] = left[j];
    }
}
#endif

/* Cosine and sine of oscillator j. Where one before, `half`, turns through half its angle a, by
 * sin 2a = 2 sin a cos a and cos 2a = 1 - 2 sin^2 a; no phase of its own is kept then. */
HDB_INLINE void HDB_FORM(sines)(int j, int half, int n, work *k)
{
    if (half < 0) {
        for (int i = 0; i < n; ++i)
            SINCOS(k->psi[j][i], &k->sine[j][i], &k->cosine[j][i]);
        return;
    }
    for (int i = 0; i < n; ++i) {
        const number sine = k->sine[half][i], twice = sine + sine;
        k->sine[j][i] = twice * k->cosine[half][i];
        k->cosine[j][i] = K(1.0) - twice * sine;
    }
}
