/* Recursion with P in rows, and what is reported of it. Part of the template of filter_rows.h. */

#if HDB_SLOW_SLOTS > 0
/* z <- F z, g <- F g, P <- F P F' + Q of the slow torque in a slot with the transition t. */
HDB_INLINE void HDB_ROWS(drift)(int slot, const double *t, filter *f)
{
    const int u = 2 * slot, v = u + 1, at = u / V, i = u % V, j = v % V;
    const double p11 = OF(f->d, u), p12 = OF(f->p[u], v), p22 = OF(f->d, v);
    const double t0 = t[0] * p11 + t[1] * p12, t1 = t[0] * p12 + t[1] * p22;
    const double u0 = t[2] * p11 + t[3] * p12, u1 = t[2] * p12 + t[3] * p22;
    part_of_row own = {0}, other = {0};
    own += 1.0;
    own[i] = t[0];
    own[j] = t[3];
    other[i] = t[1];
    other[j] = t[2];
    f->z[at] = f->z[at] * own + HDB_MOVED(f->z[at], HDB_PAIRS) * other;
    f->g[at] = f->g[at] * own + HDB_MOVED(f->g[at], HDB_PAIRS) * other;
    EACH_PART {
        const part_of_row above = f->p[u][m], below = f->p[v][m];
        f->p[u][m] = t[0] * above + t[1] * below;
        f->p[v][m] = t[2] * above + t[3] * below;
    }
    EACH_ROW {
        if (a != u && a != v)
            f->p[a][at] = f->p[a][at] * own + HDB_MOVED(f->p[a][at], HDB_PAIRS) * other;
    }
    f->p[u][at][i] = f->p[v][at][j] = 0;
    f->p[u][at][j] = f->p[v][at][i] = (t0 * t[2] + t1 * t[3]) + t[5];
    f->d[at][i] = (t0 * t[0] + t1 * t[1]) + t[4];
    f->d[at][j] = (u0 * t[2] + u1 * t[3]) + t[6];
}
#endif

/* Sum of the lanes in the order of filter_recurse.h's `along`. */
HDB_INLINE double HDB_ROWS(folded)(const part_of_row *x)
{
    part_of_row sum[8 / V];
    HDB_UNROLL
    for (int m = 0; m < 8 / V; ++m)
        sum[m] = m < PARTS ? x[m] : (part_of_row){0};
    HDB_UNROLL
    for (int m = 8 / V; m < PARTS; ++m)
        sum[m % (8 / V)] += x[m];
#if HDB_VECTOR == 8
    const part_of_row half = sum[0] + HDB_MOVED(sum[0], HDB_HALVES);
    const part_of_row pair = half + HDB_MOVED(half, HDB_QUARTERS);
#elif HDB_VECTOR == 4
    const part_of_row half = sum[0] + sum[1], pair = half + HDB_MOVED(half, HDB_HALVES);
#else
    const part_of_row pair = (sum[0] + sum[2]) + (sum[1] + sum[3]);
#endif
    return pair[0] + pair[1];
}

HDB_INLINE double HDB_ROWS(along)(const part_of_row *c, const part_of_row *x)
{
    part_of_row each[PARTS];
    EACH_PART each[m] = x[m] * c[m];
    return HDB_ROWS(folded)(each);
}

/* b = P C'. */
HDB_INLINE void HDB_ROWS(project)(const part_of_row *c, const filter *f, part_of_row *b)
{
    const double *const cs = (const double *)c;
    EACH_PART {
        part_of_row sum = f->d[m] * c[m], rest = {0};
        sum += f->p[0][m] * cs[0] + f->p[1][m] * cs[1];
        HDB_UNROLL
        for (int i = 1; i < SLOTS; ++i) {
            const part_of_row more = f->p[2 * i][m] * cs[2 * i] + f->p[2 * i + 1][m] * cs[2 * i + 1];
            rest = i > 1 ? rest + more : more;
        }
        b[m] = sum + rest;
    }
}

/* Lane `a` of g everywhere, but 0 in lane a itself; all of it of a part that has not this lane. */
HDB_INLINE part_of_row HDB_ROWS(spread)(const part_of_row *g, int a, int m)
{
#if defined(__GNUC__) && !defined(__clang__)
    HDB_ROWS(index) from = {0};
    from += a % V;
    if (a / V == m)
        from[a % V] = V;
    return __builtin_shuffle(g[a / V], (part_of_row){0}, from);
#else
    part_of_row all = {0};
    all += OF(g, a);
    if (a / V == m)
        all[a % V] = 0;
    return all;
#endif
}

/* z <- z + g e / S, P <- P - g g' / S. */
HDB_INLINE void HDB_ROWS(settle)(filter *f)
{
    EACH_PART {
        f->z[m] += f->g[m] * f->step;
        f->d[m] -= f->inverse * (f->g[m] * f->g[m]);
    }
    EACH_ROW {
        EACH_PART f->p[a][m] -= f->inverse * (f->g[m] * HDB_ROWS(spread)(f->g, a, m));
    }
}

/* Sum of what some slots predict of each sample. */
HDB_INLINE void HDB_ROWS(seen)(int count, const int *slots, int n, const table *t, double *sum)
{
    for (int i = 0; i < n; ++i) {
        double all = 0;
        HDB_UNROLL
        for (int m = 0; m < count; ++m)
            all += AT_LANE(t->seen[i], 2 * slots[m]) + AT_LANE(t->seen[i], 2 * slots[m] + 1);
        sum[i] = all;
    }
}

/* What is reported of each sample, once the chunk is done. */
HDB_INLINE void HDB_ROWS(report)(const hdb_model *model, lanes *s, int n, work *k, const table *t)
{
    for (int p = 0; p < 3; ++p) {
        int slots[SLOTS], count = 0;
        for (int b = 0; b < SLOTS; ++b) {
            const int own = HDB_ROWS(block)(model, b);
            if (own >= 0 && model->block[own].part == p)
                slots[count++] = b;
        }
        switch (count) {
        case 1: HDB_ROWS(seen)(1, slots, n, t, k->part[p]); break;
        case 2: HDB_ROWS(seen)(2, slots, n, t, k->part[p]); break;
        default: HDB_ROWS(seen)(count, slots, n, t, k->part[p]); break;
        }
    }
    double squares = s->squares, product = s->product, least = k->variance[0];
    int used = 0, since = s->since;
    for (int i = 0; i < n; ++i) {
        const double e = k->innovation[i], variance = k->variance[i];
        least = variance < least ? variance : least;
        if (HDB_LIKELY(k->flag[i] == 0)) {
            ++used;
            squares += e * e * t->inverse[i];
            product *= variance;
        }
        if (++since == 8) {
            since = 0;
            if (!(product > 1e-150 && product < 1e150)) {
                s->log_sum += log(product);
                product = 1;
            }
        }
    }
    s->used += used;
    s->squares = squares;
    s->product = product;
    s->since = since;
    for (int i = 0; i < n; ++i)
        k->filtered[i] = k->torque[i] - (k->part[0][i] + k->part[1][i]);
    if (t->worst <= HDB_RESOLVED * least)
        return; /* every block is resolved */
    for (int i = 0; i < n; ++i) {
        const double limit = HDB_RESOLVED * k->variance[i];
        int found = 0;
        HDB_UNROLL
        for (int b = 0; b < HDB_SLOTS; ++b)
            found |= AT_LANE(t->diagonal[i], 2 * b) + AT_LANE(t->diagonal[i], 2 * b + 1) > limit;
        k->flag[i] += found ? HDB_UNRESOLVED : 0;
    }
}

/* Process noise of the oscillators: per sample, per rad, per s. */
HDB_INLINE int HDB_ROWS(stirring)(const hdb_model *model, part_of_row (*noise)[PARTS])
{
    int steady = 1;
    memset(noise, 0, 3 * sizeof *noise);
    for (int a = 0; a < 2 * HDB_SLOTS; ++a) {
        const int b = HDB_ROWS(block)(model, a / 2);
        if (b < 0)
            continue;
        OF(noise[0], a) = model->block[b].q_sample;
        OF(noise[1], a) = model->block[b].q_rad;
        OF(noise[2], a) = model->block[b].q_s;
        steady = steady && !(model->block[b].q_rad > 0 || model->block[b].q_s > 0);
    }
    return steady;
}

HDB_APART void HDB_ROWS(recurse)(const hdb_model *model, lanes *s, filter *kept, table *t, int n,
                                   work *k)
{
    filter own, *const f = &own;
    part_of_row each[3][PARTS], grown[PARTS], first[PARTS];
    double gated = s->head[HDB_GATED_RUN];
    const int steady = HDB_ROWS(stirring)(model, each), gating = model->gate > 0;
    if (model->n_oscillators == 3)
        HDB_ROWS(arrange)(3, k, n, t);
    else
        HDB_ROWS(arrange)(model->n_oscillators, k, n, t);
    HDB_ROWS(copy)(kept, f);
    EACH_PART {
        first[m] = f->d[m];
        grown[m] = steady ? each[0][m] * (double)n : (part_of_row){0};
    }
    for (int i = 0; i < n; ++i) {
        const part_of_row *const c = t->c[i];
        part_of_row b[PARTS];
#if HDB_SLOW_SLOTS > 0
        HDB_UNROLL
        for (int slow = 0; slow < HDB_SLOW_SLOTS; ++slow) {
            if (slow < model->n_slow)
                HDB_ROWS(drift)(HDB_SLOTS + slow, k->f[slow][i], f);
        }
#endif
        EACH_PART {
            part_of_row noise = each[0][m];
            if (!steady)
                noise = (noise + each[1][m] * hdb_abs(k->turn[i])) + each[2][m] * k->dt[i];
            if (!steady)
                grown[m] += noise;
            f->d[m] += noise;
        }
        const double ahead = HDB_ROWS(along)(c, f->g), before = HDB_ROWS(along)(c, f->z);
        const double innovation = (k->residual[i] - before) - ahead * f->step;
        HDB_ROWS(project)(c, f, b);
        const double fw = ahead * f->inverse;
        const double variance = model->r + (HDB_ROWS(along)(c, b) - ahead * fw);
        HDB_ROWS(settle)(f);
        EACH_PART {
            t->seen[i][m] = f->z[m] * c[m];
            f->g[m] = b[m] - f->g[m] * fw;
        }
        int flag = k->residual[i] == k->residual[i] ? 0 : HDB_MISSING;
        f->inverse = 1.0 / variance;
        if (gating && !flag) {
            const int beyond = innovation * innovation > model->gate * variance &&
                               gated < model->gate_samples;
            flag = beyond ? HDB_GATED : 0;
            gated = beyond ? gated + 1 : 0;
        }
        f->step = f->inverse * innovation;
        if (HDB_RARELY(flag))
            f->inverse = f->step = 0;
        EACH_PART t->diagonal[i][m] = f->d[m] - f->inverse * (f->g[m] * f->g[m]);
        k->innovation[i] = innovation;
        k->variance[i] = variance;
        k->flag[i] = flag;
        t->inverse[i] = f->inverse;
    }
    t->worst = 0; /* a bound of every sum of two */
    for (int a = 0; a < 2 * HDB_SLOTS; ++a) {
        const double most = 2 * (OF(first, a) + OF(grown, a));
        t->worst = most > t->worst ? most : t->worst;
    }
    HDB_ROWS(copy)(f, kept);
    s->head[HDB_GATED_RUN] = gated;
    HDB_ROWS(report)(model, s, n, k, t);
}
