/* Last part of the template: load and store, and one chunk with the code for its number of blocks.
 * HDB_FEW(name) and HDB_MANY(name) are the shapes for up to four blocks and for more. */
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
    for (int i = 0; i < AT(2 * nb, 0); ++i)
        LANE(s->p[i], lane) = *state++;
#ifdef HDB_SUMS
    LANE(s->used, lane) = LANE(s->log_sum, lane) = LANE(s->squares, lane) = 0;
    LANE(s->product, lane) = 1;
    s->since = 0;
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
    for (int i = 0; i < AT(2 * nb, 0); ++i)
        *state++ = LANE(s->p[i], lane);
}
#endif

HDB_INLINE void HDB_FORM(filter)(const hdb_model *model, lanes *s, int n, work *k, hdb_real *record)
{
#define WITH(n_oscillators, n_slow, shape)                                                        \
    HDB_FORM(turn)(n_oscillators, n_slow, model, s, n, k);                                        \
    shape(recurse)(n_oscillators, n_slow, model, s, n, k, record)
#ifdef HDB_N_OSCILLATORS /* fixed by the build */
    WITH(HDB_N_OSCILLATORS, HDB_N_SLOW, HDB_FEW);
#else
    const int no = model->n_oscillators, ns = model->n_slow;
    if (no == 3 && ns == 0) { /* the presets, and report-6 with a slow torque */
        WITH(3, 0, HDB_FEW);
    } else if (no == 2 && ns == 0) {
        WITH(2, 0, HDB_FEW);
    } else if (no == 3 && ns == 1) {
        WITH(3, 1, HDB_FEW);
    } else {
        WITH(no, ns, HDB_MANY);
    }
#endif
#undef WITH
}

#undef number
#undef mask
#undef lanes
#undef work
#undef PICK
#undef ANY
#undef LANE
#undef EACH_LANE
#undef L
#undef STATES
#undef AT
