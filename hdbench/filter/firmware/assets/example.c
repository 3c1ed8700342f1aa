/* A 1 kHz torque loop with the filter in it. Replace the four functions by those of your board. */
#include "hdb_model.h"

float read_torque_nm(void);       /* bridge, scaled by the calibration's gain; NAN if not valid */
float read_velocity_rad_s(void);  /* wave generator; NAN if not valid */
void write_torque_nm(float torque_nm);
void raise_alarm(void);
void timer_interrupt(void);

static hdb_state state;       /* all zero: nothing seen yet */
static unsigned missing_in_a_row;

/* Runs every HDB_SAMPLE_PERIOD_S. It needs no heap, no library and the same time each call. */
void timer_interrupt(void)
{
    hdb_output out;
    const hdb_real torque = (hdb_real)read_torque_nm();
    const hdb_real velocity = (hdb_real)read_velocity_rad_s();

    hdb_filter_step(&hdb_exported_model, &state, HDB_SAMPLE_PERIOD_S, velocity, torque, &out);

    /* flags: HDB_MISSING, the sample only predicted; HDB_GATED, it was an outlier;
     * HDB_UNRESOLVED, at this speed (standstill) the data do not tell some orders apart */
    if (out.flag & HDB_MISSING) {
        if (++missing_in_a_row > 10)
            raise_alarm();
        return; /* hold the last command */
    }
    missing_in_a_row = 0;
    write_torque_nm((float)out.filtered);
}
