/* The samples of one chunk, one after the other. A template on top of filter_lanes.h: define
 * HDB_SHAPE(name) before each inclusion. P_ij is the same expression in both shapes of P:
 *   HDB_ROWS  full rows as vectors of the compiler, one lane, up to HDB_ROW_STATES states;
 *   else      the lower triangle. */

#include "filter_shape.h"

/* Set z and P of the lanes that see their first sample; keep those that still wait at zero. */
HDB_INLINE void HDB_SHAPE(begin)(int no, int nb, const hdb_model *model, lanes *s, work *k,
                                 int i, filter *f)
{
    EACH_LANE {
        if (LANE(s->head[HDB_STARTED], l) > 0)
            continue;
        const hdb_real residual = LANE(k->residual[i], l);
        const int now = model->prior_start || residual == residual;
        const hdb_real first = now && !model->prior_start ? residual : 0;
        for (int m = 0; m < 2 * nb; ++m)
            for (int j = 0; j < 2 * nb; ++j)
                LANE(P(m, j), l) = 0;
        for (int m = 0; m < 3; ++m)
            LANE(k->part[m][i], l) = 0;
        LANE(k->filtered[i], l) = LANE(k->torque[i], l);
        LANE(k->innovation[i], l) = residual;
        for (int b = 0; b < nb; ++b) {
            for (int m = 0; m < 2; ++m) {
                const hdb_real prior = model->prior_start ? model->block[b].prior[m] : 1;
                LANE(P(2 * b + m, 2 * b + m), l) = now ? prior : 0;
                LANE(D(2 * b + m), l) = now ? prior : 0;
            }
            LANE(Z(2 * b), l) = b < no ? LANE(k->cosine[b][i], l) * first : 0;
            LANE(Z(2 * b + 1), l) = b < no ? LANE(k->sine[b][i], l) * first : 0;
            LANE(k->innovation[i], l) -= first;
        }
        LANE(s->head[HDB_STARTED], l) = now ? 1 : 0;
    }
}

/* Flags, innovation variance, and its inverse: 0 where the sample only predicts. */
HDB_INLINE number HDB_SHAPE(weigh)(int no, int nb, const hdb_model *model, lanes *s, work *k, int i,
                                   const filter *f)
{
    const number none = {0};
    number sum = none + model->r;
    HDB_UNROLL
    for (int b = 0; b < nb; ++b)
        sum += b < no ? G(2 * b) * k->cosine[b][i] + G(2 * b + 1) * k->sine[b][i] : G(2 * b);
    k->variance[i] = sum;
    k->flag[i] = PICK(k->residual[i] == k->residual[i], none, none + HDB_MISSING);
    if (model->gate > 0) { /* counts gated samples in a row */
        EACH_LANE {
            const hdb_real e = LANE(k->innovation[i], l), run = LANE(s->head[HDB_GATED_RUN], l);
            if (LANE(k->flag[i], l) > 0)
                continue;
            const int beyond = e * e > model->gate * LANE(sum, l) && run < model->gate_samples;
            LANE(k->flag[i], l) = beyond ? HDB_GATED : 0;
            LANE(s->head[HDB_GATED_RUN], l) = beyond ? run + 1 : 0;
        }
    }
    return PICK(k->flag[i] == none, K(1.0) / sum, none);
}

/* Which blocks the data do not tell; no variance where a lane has not started. */
HDB_INLINE void HDB_SHAPE(judge)(int no, const lanes *s, work *k, int i, const filter *f)
{
    const number none = {0}, unresolved = none + HDB_UNRESOLVED;
    mask found = {0};
    HDB_UNROLL
    for (int b = 0; b < no; ++b)
        found |= D(2 * b) + D(2 * b + 1) > HDB_RESOLVED * k->variance[i];
    k->flag[i] += PICK(found, unresolved, none);
    k->variance[i] = PICK(s->head[HDB_STARTED] > none, k->variance[i], none + HDB_NAN);
}

/* Inlined once per usual number of blocks, so that all loops unroll. `record` sees each prediction:
 * z, lower triangle of P, 1/S (NaN: not started, 0: only predicted), innovation. */
HDB_INLINE void HDB_SHAPE(recurse)(int no, int ns, const hdb_model *model, lanes *s, int n, work *k,
                                   hdb_real *record)
{
    const int nb = no + ns;
    const number none = {0};
    filter own, *const f = &own;
#ifdef HDB_ROWS
    HDB_SHAPE(unpack)(nb, s, f);
#else
    f->s = s;
#endif
    for (int i = 0; i < n; ++i) {
        HDB_SHAPE(predict)(no, nb, model, k, i, f);
        const mask waiting = s->head[HDB_STARTED] == none;
        if (ANY(waiting))
            HDB_SHAPE(begin)(no, nb, model, s, k, i, f);
        HDB_SHAPE(project)(no, nb, k, i, f);
        const number inverse = HDB_SHAPE(weigh)(no, nb, model, s, k, i, f);
        const number e = PICK(k->flag[i] == none, k->innovation[i], none);
#ifdef HDB_RECORDS
        if (record != NULL) {
            for (int a = 0; a < 2 * nb; ++a)
                *record++ = Z(a);
            for (int a = 0; a < 2 * nb; ++a)
                for (int b = 0; b <= a; ++b)
                    *record++ = P(a, b);
            *record++ = s->head[HDB_STARTED] > none ? inverse : HDB_NAN;
            *record++ = e;
        }
#else
        (void)record;
#endif
        const number step = inverse * e;
#ifdef HDB_ROWS
        EACH_PART {
            f->z[m] += f->g[m] * step;
            f->diagonal[m] -= inverse * (f->g[m] * f->g[m]);
        }
        HDB_UNROLL
        for (int a = 0; a < 2 * nb; ++a)
            EACH_PART f->p[a][m] -= inverse * (f->g[m] * G(a));
#else
        HDB_UNROLL
        for (int a = 0; a < 2 * nb; ++a) {
            Z(a) += G(a) * step;
            HDB_UNROLL
            for (int b = 0; b <= a; ++b)
#ifdef HDB_SINGLE /* one product less; the rows of the host need the symmetric one */
                P(a, b) -= (inverse * G(a)) * G(b);
#else
                P(a, b) -= inverse * (G(a) * G(b));
#endif
        }
#endif
#ifdef HDB_SUMS
        const mask used = k->flag[i] == none;
        s->used += PICK(used, none + 1, none);
        s->squares += e * e * inverse;
        s->product *= PICK(used, k->variance[i], none + 1);
        if (++s->since == 8) { /* the logarithm is taken of products */
            s->since = 0;
            EACH_LANE {
                if (!(LANE(s->product, l) > 1e-150 && LANE(s->product, l) < 1e150)) {
                    LANE(s->log_sum, l) += log(LANE(s->product, l));
                    LANE(s->product, l) = 1;
                }
            }
        }
#endif
        HDB_SHAPE(judge)(no, s, k, i, f);
    }
#ifdef HDB_ROWS
    HDB_SHAPE(pack)(nb, f, s);
#endif
}

#undef filter
#undef part_of_row
#undef V
#undef PARTS
#undef EACH_PART
#undef D
#undef Z
#undef G
#undef P
