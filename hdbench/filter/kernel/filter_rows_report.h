/* What is reported of samples filtered in rows. Part of the template of filter_rows.h. */

typedef struct {
    double used, product, log_sum, squares;
    int since;
} HDB_ROWS(tally);
#define tally HDB_ROWS(tally)

/* What a sample adds to the likelihood. */
HDB_INLINE void HDB_ROWS(count)(tally *sums, int used, double e, double variance, double inverse)
{
    if (HDB_LIKELY(used)) {
        sums->used += 1;
        sums->squares += e * e * inverse;
        sums->product *= variance;
    }
    if (++sums->since < 8)
        return;
    sums->since = 0;
    if (!(sums->product > 1e-150 && sums->product < 1e150)) {
        sums->log_sum += log(sums->product);
        sums->product = 1;
    }
}

/* Sum of what some slots predict of each sample. */
HDB_INLINE void HDB_ROWS(seen)(int count, const int *slots, int n, const table *t, double *sum)
{
    for (int i = 0; i < n; ++i) {
        double all = 0;
        HDB_UNROLL
        for (int m = 0; m < count; ++m)
            all += AT_LANE(t->seen[i], 2 * slots[m]);
        sum[i] = all;
    }
}

/* Variance of a state after sample i. */
HDB_INLINE double HDB_ROWS(left)(const table *t, int i, int a)
{
    const double g = AT_LANE(t->g[i], a);
    return AT_LANE(t->d[i], a) - t->inverse[i] * (g * g);
}

/* What is reported of each sample, once the chunk is done. */
HDB_INLINE void HDB_ROWS(report)(const hdb_model *model, int n, work *k, const table *t)
{
    for (int p = 0; p < 3; ++p) {
        int slots[SLOTS], count = 0;
        for (int b = 0; b < SLOTS; ++b) {
            const int own = HDB_ROWS(block)(model, b);
            if (own >= 0 && model->block[own].part == p)
                slots[count++] = b;
        }
        switch (count) { /* unrolled */
        case 0: HDB_ROWS(seen)(0, slots, n, t, k->part[p]); break;
        case 1: HDB_ROWS(seen)(1, slots, n, t, k->part[p]); break;
        case 2: HDB_ROWS(seen)(2, slots, n, t, k->part[p]); break;
        default: HDB_ROWS(seen)(count, slots, n, t, k->part[p]); break;
        }
    }
    for (int i = 0; i < n; ++i)
        k->filtered[i] = k->torque[i] - (k->part[0][i] + k->part[1][i]);
    if (t->worst <= HDB_RESOLVED * t->least)
        return; /* every block is resolved */
    for (int i = 0; i < n; ++i) {
        const double limit = HDB_RESOLVED * k->variance[i];
        int found = 0;
        HDB_UNROLL
        for (int b = 0; b < HDB_SLOTS; ++b)
            found |= HDB_ROWS(left)(t, i, 2 * b) + HDB_ROWS(left)(t, i, 2 * b + 1) > limit;
        k->flag[i] += found ? HDB_UNRESOLVED : 0;
    }
}
