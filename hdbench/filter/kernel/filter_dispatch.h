/* Last part of the template: load and store, and one chunk.
 * HDB_UNROLLED asks for a version for three oscillators without slow torques. */
#ifndef HDB_IN_PLACE
/* The parts of a state between its vector of numbers and one lane. */
HDB_INLINE void HDB_FORM(load)(int nb, lanes *s, const hdb_real *state, int lane)
{
    (void)lane;
    for (int i = 0; i < HDB_HEADER; ++i)
        LANE(s->head[i], lane) = *state++;
    for (int i = 0; i < nb; ++i)
        LANE(s->psi[i], lane) = *state++;
    for (int i = 0; i < nb; ++i)
        LANE(s->left[i], lane) = *state++;
    for (int i = 0; i < 2 * nb; ++i)
        LANE(s->z[i], lane) = *state++;
    for (int i = 0; i < 2 * nb; ++i)
        LANE(s->g[i], lane) = *state++;
    for (int i = 0; i < AT(2 * nb, 0); ++i)
        LANE(s->p[i], lane) = *state++;
#ifdef HDB_SUMS
    LANE(s->used, lane) = LANE(s->log_sum, lane) = LANE(s->squares, lane) = 0;
    LANE(s->product, lane) = 1;
    s->since = 0;
    s->waiting = 1;
#endif
}

HDB_INLINE void HDB_FORM(store)(int nb, lanes *s, hdb_real *state, int lane)
{
    (void)lane;
    for (int i = 0; i < HDB_HEADER; ++i)
        *state++ = LANE(s->head[i], lane);
    for (int i = 0; i < nb; ++i)
        *state++ = LANE(s->psi[i], lane);
    for (int i = 0; i < nb; ++i)
        *state++ = LANE(s->left[i], lane);
    for (int i = 0; i < 2 * nb; ++i)
        *state++ = LANE(s->z[i], lane);
    for (int i = 0; i < 2 * nb; ++i)
        *state++ = LANE(s->g[i], lane);
    for (int i = 0; i < AT(2 * nb, 0); ++i)
        *state++ = LANE(s->p[i], lane);
}
#endif

HDB_INLINE void HDB_FORM(filter)(const hdb_model *model, lanes *s, int n, work *k, hdb_real *record)
{
#ifdef HDB_N_OSCILLATORS /* fixed by the build */
    const int no = HDB_N_OSCILLATORS, ns = HDB_N_SLOW;
#else
    const int no = model->n_oscillators, ns = model->n_slow;
#endif
    HDB_FORM(turn)(no, ns, model, s, n, k);
#ifdef HDB_COASTS
    HDB_FORM(coast)(model, s, n, k);
#endif
    HDB_FORM(stir)(no, model, n, k);
#ifdef HDB_UNROLLED /* the presets' orders */
    if (no == 3 && ns == 0) {
        HDB_FORM(recurse)(3, 0, model, s, n, k, record);
        return;
    }
#endif
    HDB_FORM(recurse)(no, ns, model, s, n, k, record);
}

#undef number
#undef mask
#undef SINCOS
#undef lanes
#undef work
#undef PICK
#undef ANY
#undef HDB_NOT
#undef LANE
#undef EACH_LANE
#undef L
#undef STATES
#undef AT
