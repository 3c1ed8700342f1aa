/* The samples of one chunk, one after the other, with the lower triangle of P in place. Second part
 * of the template that filter_motion.h begins; HDB_UNROLLED asks for a version for three oscillators
 * without slow torques. */

#ifdef HDB_IN_PLACE /* a call would keep a sample's numbers out of registers */
#define HDB_RARE HDB_INLINE
#else
#define HDB_RARE HDB_COLD
#endif
#ifdef HDB_SUMS
#define HDB_WAITING(s) ((s)->waiting)
#else
#define HDB_WAITING(s) (!((s)->head[HDB_STARTED] > 0))
#endif
#define P(i, j) s->p[(i) > (j) ? AT(i, j) : AT(j, i)]

/* z <- F z, g <- F g, P <- F P F' + Q of slow block b with the transition t. */
HDB_INLINE void HDB_FORM(drift)(int nb, int b, const hdb_real *t, lanes *s)
{
    const int u = 2 * b, v = 2 * b + 1;
    const number z0 = s->z[u], z1 = s->z[v], p11 = P(u, u), p12 = P(u, v), p22 = P(v, v);
    const number t0 = t[0] * p11 + t[1] * p12, t1 = t[0] * p12 + t[1] * p22;
    const number u0 = t[2] * p11 + t[3] * p12, u1 = t[2] * p12 + t[3] * p22;
    s->z[u] = t[0] * z0 + t[1] * z1;
    s->z[v] = t[2] * z0 + t[3] * z1;
#ifndef HDB_SINGLE
    const number g0 = s->g[u], g1 = s->g[v];
    s->g[u] = t[0] * g0 + t[1] * g1;
    s->g[v] = t[2] * g0 + t[3] * g1;
#endif
    for (int j = 0; j < 2 * nb; ++j) {
        const number above = P(u, j), below = P(v, j);
        P(u, j) = t[0] * above + t[1] * below;
        P(v, j) = t[2] * above + t[3] * below;
    }
    P(u, u) = (t0 * t[0] + t1 * t[1]) + t[4];
    P(u, v) = (t0 * t[2] + t1 * t[3]) + t[5];
    P(v, v) = (u0 * t[2] + u1 * t[3]) + t[6];
}

#ifdef HDB_SINGLE
/* Variance that the data do not bound (standstill) grows until a float's P loses its sign: beyond
 * a limit, rows and columns of the block shrink by what the noise would add. */
HDB_INLINE void HDB_FORM(hold)(int nb, int b, hdb_real r, hdb_real noise, lanes *s)
{
    const hdb_real both = P(2 * b, 2 * b) + P(2 * b + 1, 2 * b + 1);
    if (!(both > HDB_HELD * (r + noise)))
        return;
    const hdb_real less = K(1.0) - noise / both;
    for (int a = 2 * b; a < 2 * b + 2; ++a) {
        for (int j = 0; j < 2 * nb; ++j)
            P(a, j) *= less;
        P(a, a) *= less;
    }
}
#endif

/* C x. A double's sum stands as vectors of the host are folded: even and odd states apart, every
 * fourth slot together, slow torques in slots after the third. */
HDB_INLINE number HDB_FORM(along)(int no, int nb, const work *k, int i, const number *x)
{
    const number none = {0};
#ifdef HDB_SINGLE
    number all = none;
    HDB_UNROLL
    for (int b = 0; b < nb; ++b) {
        all += b < no ? x[2 * b] * k->cosine[b][i] : x[2 * b];
        if (b < no)
            all += x[2 * b + 1] * k->sine[b][i];
    }
    return all;
#else
    number even[4] = {none, none, none, none}, odd[4] = {none, none, none, none};
    HDB_UNROLL
    for (int b = 0; b < nb; ++b) {
        const int slot = (b < no || no > 3 ? b : b - no + 3) % 4;
        even[slot] += b < no ? x[2 * b] * k->cosine[b][i] : x[2 * b];
        if (b < no)
            odd[slot] += x[2 * b + 1] * k->sine[b][i];
    }
    return ((even[0] + even[2]) + (even[1] + even[3])) + ((odd[0] + odd[2]) + (odd[1] + odd[3]));
#endif
}

/* Transitions of the slow torques, and noise of the oscillators' step. */
HDB_INLINE void HDB_FORM(move)(int no, int nb, const hdb_model *model, work *k, int i, lanes *s)
{
    HDB_UNROLL
    for (int b = 0; b < nb; ++b) {
        if (b >= no) {
            HDB_FORM(drift)(nb, b, k->f[b - no][i], s);
            continue;
        }
#ifdef HDB_SINGLE
        HDB_FORM(hold)(nb, b, model->r, k->noise[b][i], s);
#endif
        P(2 * b, 2 * b) += k->noise[b][i];
        P(2 * b + 1, 2 * b + 1) += k->noise[b][i];
    }
    (void)model;
}

/* What the blocks of each part predict, and the innovation, found from z without the measurement
 * to be done, which it is then. `ahead` is C g of that. */
HDB_INLINE void HDB_FORM(predict)(int no, int nb, const hdb_model *model, work *k, int i,
                                  number ahead, lanes *s)
{
    const number none = {0};
    number ripple = none, misalignment = none, slow = none;
    k->innovation[i] = k->residual[i] - HDB_FORM(along)(no, nb, k, i, s->z);
#ifdef HDB_SINGLE
    (void)ahead;
#else
    k->innovation[i] -= ahead * s->head[HDB_STEP];
    HDB_UNROLL
    for (int a = 0; a < 2 * nb; ++a)
        s->z[a] += s->g[a] * s->head[HDB_STEP];
#endif
    HDB_UNROLL
    for (int b = 0; b < nb; ++b) {
        const number seen =
            b < no ? s->z[2 * b] * k->cosine[b][i] + s->z[2 * b + 1] * k->sine[b][i] : s->z[2 * b];
        if (b >= no)
            slow += seen;
        else if (model->block[b].part == HDB_RIPPLE)
            ripple += seen;
        else
            misalignment += seen;
    }
    k->part[HDB_RIPPLE][i] = ripple;
    k->part[HDB_MISALIGNMENT][i] = misalignment;
    k->part[HDB_SLOW][i] = slow;
    k->filtered[i] = k->torque[i] - (ripple + misalignment);
}

/* Set z and P of the lanes that see their first sample; keep those that still wait at zero. */
HDB_RARE void HDB_FORM(begin)(int no, int nb, const hdb_model *model, lanes *s, work *k, int i)
{
    int still = 0;
    EACH_LANE {
        if (LANE(s->head[HDB_STARTED], l) > 0)
            continue;
        const hdb_real residual = LANE(k->residual[i], l);
        const int now = model->prior_start || residual == residual;
        const hdb_real first = now && !model->prior_start ? residual : 0;
        for (int m = 0; m < AT(2 * nb, 0); ++m)
            LANE(s->p[m], l) = 0;
        for (int m = 0; m < 3; ++m)
            LANE(k->part[m][i], l) = 0;
        LANE(k->filtered[i], l) = LANE(k->torque[i], l);
        LANE(k->innovation[i], l) = residual;
        for (int b = 0; b < nb; ++b) {
            for (int m = 0; m < 2; ++m) {
                const hdb_real prior = model->prior_start ? model->block[b].prior[m] : 1;
                LANE(P(2 * b + m, 2 * b + m), l) = now ? prior : 0;
            }
            LANE(s->z[2 * b], l) = b < no ? LANE(k->cosine[b][i], l) * first : 0;
            LANE(s->z[2 * b + 1], l) = b < no ? LANE(k->sine[b][i], l) * first : 0;
            LANE(k->innovation[i], l) -= first;
        }
        LANE(s->head[HDB_STARTED], l) = now ? 1 : 0;
        still |= !now;
    }
#ifdef HDB_SUMS
    s->waiting = still;
#else
    (void)still;
#endif
}

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

#ifdef HDB_RECORDS
/* Write a prediction: z, lower triangle of P, 1/S (NaN: not started, 0: only predicted), e. */
HDB_INLINE hdb_real *HDB_FORM(note)(int nb, const lanes *s, number inverse, number e,
                                    hdb_real *record)
{
    for (int a = 0; a < 2 * nb; ++a)
        *record++ = s->z[a];
    for (int a = 0; a < AT(2 * nb, 0); ++a)
        *record++ = s->p[a];
    *record++ = s->head[HDB_STARTED] > 0 ? inverse : HDB_NAN;
    *record++ = e;
    return record;
}
#endif

/* Inlined once per usual number of blocks, so that all loops unroll. `record` is NULL, or takes
 * each prediction. */
HDB_INLINE void HDB_FORM(recurse)(int no, int ns, const hdb_model *model, lanes *s, int n, work *k,
                                  hdb_real *record)
{
    const int nb = no + ns;
    const number none = {0};
    number g[STATES];
    (void)record;
    for (int i = 0; i < n; ++i) {
        HDB_FORM(move)(no, nb, model, k, i, s);
#ifdef HDB_SINGLE
        const number ahead = none;
#else
        const number ahead = HDB_FORM(along)(no, nb, k, i, s->g), fw = ahead * s->head[HDB_INVERSE];
#endif
        HDB_FORM(predict)(no, nb, model, k, i, ahead, s);
        if (HDB_WAITING(s))
            HDB_FORM(begin)(no, nb, model, s, k, i);
        HDB_FORM(project)(no, nb, k, i, s, g);
        number variance = HDB_FORM(along)(no, nb, k, i, g);
#ifndef HDB_SINGLE
        variance -= ahead * fw;
        HDB_FORM(settle)(nb, g, fw, s);
#endif
        variance += model->r;
        const number inverse = HDB_FORM(weigh)(model, s, k, i, variance);
        const number e = PICK(k->flag[i] == none, k->innovation[i], none), step = inverse * e;
#ifdef HDB_RECORDS
        if (record != NULL)
            record = HDB_FORM(note)(nb, s, inverse, e, record);
#endif
#ifdef HDB_SINGLE
        HDB_FORM(measure)(nb, g, inverse, step, s);
#else
        s->head[HDB_INVERSE] = inverse;
        s->head[HDB_STEP] = step;
#endif
#ifdef HDB_SUMS
        const mask used = k->flag[i] == none;
        s->used += PICK(used, none + 1, none);
        s->squares += e * e * inverse;
        s->product *= PICK(used, k->variance[i], none + 1);
        HDB_FORM(tally)(s);
#endif
        HDB_FORM(judge)(no, s, k, i);
    }
}

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

#undef P
#undef HDB_WAITING
#undef HDB_RARE
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
