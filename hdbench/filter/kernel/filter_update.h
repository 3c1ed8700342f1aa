/* What a measurement does to P. Part of the template of filter_recurse.h. */

/* g = P C': the diagonal with the first block, then the others. */
HDB_INLINE void HDB_FORM(project)(int no, int nb, const work *k, int i, const lanes *s, number *g)
{
    const number none = {0};
    HDB_UNROLL
    for (int j = 0; j < 2 * nb; ++j) {
        const int at = j / 2;
        number sum = P(j, j), rest = none;
        if (at < no)
            sum = sum * (j % 2 ? k->sine[at][i] : k->cosine[at][i]);
        else if (j % 2)
            sum = none;
        HDB_UNROLL
        for (int b = 0; b < nb; ++b) {
            number more = none;
            if (b >= no)
                more = j == 2 * b ? none : P(2 * b, j);
            else if (j == 2 * b)
                more = P(j + 1, j) * k->sine[b][i];
            else if (j == 2 * b + 1)
                more = P(j, j - 1) * k->cosine[b][i];
            else
                more = P(2 * b, j) * k->cosine[b][i] + P(2 * b + 1, j) * k->sine[b][i];
            if (b == 0)
                sum += more;
            else
                rest = b > 1 ? rest + more : more;
        }
        g[j] = sum + rest;
    }
}

/* Flags and 1/S: 0 where the sample only predicts. */
HDB_INLINE number HDB_FORM(weigh)(const hdb_model *model, lanes *s, work *k, int i, number variance)
{
    const number none = {0};
    k->variance[i] = variance;
    k->flag[i] = PICK(k->residual[i] == k->residual[i], none, none + HDB_MISSING);
    if (model->gate > 0) { /* counts gated samples in a row */
        EACH_LANE {
            const hdb_real e = LANE(k->innovation[i], l), run = LANE(s->head[HDB_GATED_RUN], l);
            if (LANE(k->flag[i], l) > 0)
                continue;
            const int beyond =
                e * e > model->gate * LANE(variance, l) && run < model->gate_samples;
            LANE(k->flag[i], l) = beyond ? HDB_GATED : 0;
            LANE(s->head[HDB_GATED_RUN], l) = beyond ? run + 1 : 0;
        }
    }
    return PICK(k->flag[i] == none, K(1.0) / variance, none);
}

/* Which blocks the data do not tell; no variance where a lane has not started. */
HDB_INLINE void HDB_FORM(judge)(int no, const lanes *s, work *k, int i)
{
    const number none = {0};
#ifndef HDB_UNFLAGGED
    const number unresolved = none + HDB_UNRESOLVED;
    mask found = {0};
    HDB_UNROLL
    for (int b = 0; b < no; ++b) {
        number own = P(2 * b, 2 * b), other = P(2 * b + 1, 2 * b + 1);
#ifndef HDB_SINGLE
        own -= s->head[HDB_INVERSE] * (s->g[2 * b] * s->g[2 * b]);
        other -= s->head[HDB_INVERSE] * (s->g[2 * b + 1] * s->g[2 * b + 1]);
#endif
        found |= own + other > HDB_RESOLVED * k->variance[i];
    }
    k->flag[i] += PICK(found, unresolved, none);
#endif
    (void)no;
    k->variance[i] = PICK(s->head[HDB_STARTED] > none, k->variance[i], none + HDB_NAN);
}

#ifdef HDB_SINGLE
/* z <- z + g e / S, P <- P - g g' / S. */
HDB_INLINE void HDB_FORM(measure)(int nb, const number *g, number inverse, number step,
                                  lanes *s)
{
    HDB_UNROLL
    for (int a = 0; a < 2 * nb; ++a) {
        s->z[a] += g[a] * step;
        HDB_UNROLL
        for (int b = 0; b <= a; ++b) /* not symmetric in a and b, but a product less */
            P(a, b) -= (inverse * g[a]) * g[b];
    }
}
#else
/* P <- P - g g' / S of the sample before; then g is that of this sample, found from `b`, P C'
 * without that measurement. */
HDB_INLINE void HDB_FORM(settle)(int nb, const number *b, number fw, lanes *s)
{
    const number inverse = s->head[HDB_INVERSE];
    HDB_UNROLL
    for (int j = 0; j < 2 * nb; ++j) {
        HDB_UNROLL
        for (int m = 0; m <= j; ++m)
            P(j, m) -= inverse * (s->g[j] * s->g[m]);
    }
    HDB_UNROLL
    for (int j = 0; j < 2 * nb; ++j)
        s->g[j] = b[j] - s->g[j] * fw;
}
#endif
