/* Filters the test vectors and compares with the host's answers. Exit code 0: passed. */
#include "hdb_model.h"
#include "hdb_vectors.h"

#ifdef HDB_TARGET /* no library: see target.c */
void target_write(const char *text);
unsigned long target_ticks(void);
#define write_text target_write
#define TICKS target_ticks
int target_main(void);
#define main target_main
#else
#include <stdio.h>
static void write_text(const char *text) { (void)fputs(text, stdout); }
#endif

static void write_number(const char *name, unsigned long value, const char *unit)
{
    char text[24];
    unsigned at = sizeof text;
    text[--at] = '\0';
    do {
        text[--at] = (char)('0' + value % 10);
        value /= 10;
    } while (value > 0);
    write_text(name);
    write_text(text + at);
    write_text(unit);
}

static hdb_real distance(hdb_real a, hdb_real b) { return a < b ? b - a : a - b; }

int main(void)
{
    static hdb_state state;
    hdb_output out = {0};
    hdb_real worst = 0;
    unsigned long wrong = 0, flags = 0;
    if (hdb_model_check(&hdb_exported_model) != HDB_OK) {
        write_text("FAILED: a number of the model is out of its domain\n");
        return 2;
    }
    for (int k = 0; k < HDB_VECTORS; ++k) {
        const hdb_real wanted = hdb_vector_filtered[k];
        hdb_filter_step(&hdb_exported_model, &state, HDB_SAMPLE_PERIOD_S, hdb_vector_velocity[k],
                        hdb_vector_torque[k], &out);
        if ((out.flag & ~HDB_UNRESOLVED) != (hdb_vector_flag[k] & ~HDB_UNRESOLVED))
            ++flags; /* near its limit a float may call a block resolved a sample earlier */
        if (!(wanted == wanted)) {
            wrong += out.filtered == out.filtered ? 1U : 0U;
            continue;
        }
        const hdb_real away = distance(out.filtered, wanted);
        const int resolved = (hdb_vector_flag[k] & HDB_UNRESOLVED) == 0;
        if (!(away <= (resolved ? HDB_TOLERANCE : HDB_TOLERANCE_UNRESOLVED)))
            ++wrong;
        if (away > worst)
            worst = away;
    }
#ifdef TICKS
    state = (hdb_state){0};
    const unsigned long start = TICKS();
    for (int k = 0; k < HDB_VECTORS; ++k)
        hdb_filter_step(&hdb_exported_model, &state, HDB_SAMPLE_PERIOD_S, hdb_vector_velocity[k],
                        hdb_vector_torque[k], &out);
    write_number("instructions per sample ", (TICKS() - start) / HDB_VECTORS, "\n");
#endif
    write_number("samples ", HDB_VECTORS, "\n");
    worst *= (hdb_real)1000000000.0f;
    write_number("largest difference ", (unsigned long)worst, " nN m\n");
    write_number("samples beyond the tolerance ", wrong, "\n");
    write_number("samples flagged otherwise ", flags, "\n");
    write_text(wrong + flags > 0 ? "FAILED\n" : "PASSED\n");
    return wrong + flags > 0 ? 1 : 0;
}
