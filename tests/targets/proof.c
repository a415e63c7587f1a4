/* For an abstract interpreter: no call has undefined behaviour, whatever it is told and however often it was called
 * before.
 *
 * By induction: of the state only what is asserted at the end is assumed at the beginning, and of numbers not even that
 * they are numbers. */
#include "__fc_builtin.h"
#include "foreswitch_design.h"

static fsw_state state;

static fsw_real any(void)
{
    union {
        unsigned char bytes[sizeof(fsw_real)];
        fsw_real value;
    } as;
    for (unsigned i = 0; i < sizeof(fsw_real); i++) as.bytes[i] = (unsigned char)Frama_C_interval(0, 255);
    return as.value;
}

static void many(fsw_real *to, int count)
{
    for (int i = 0; i < count; i++) to[i] = any();
}

int main(void)
{
    fsw_real x[FSW_MAX_STATES], reference[FSW_MAX_OUTPUTS * FSW_ORDER], w[FSW_MAX_DISTURBANCES], u[FSW_MAX_INPUTS];
    fsw_real costs[FSW_CANDIDATES];
    uint8_t line[FSW_MAX_LINE];
    uint32_t wait[FSW_MAX_INPUTS];
    const int rows = FSW_MAX_LINE / FSW_MAX_INPUTS;
    if (fsw_init(&controller, &state) != FSW_VALID) return 1;
    //@ assert started: state.head < rows;

    many(state.x, FSW_MAX_STATES);
    many(state.w, FSW_MAX_DISTURBANCES);
    state.head = (uint16_t)Frama_C_interval(0, rows - 1);
    state.bad = (uint16_t)Frama_C_interval(0, 65535);
    state.bad_total = Frama_C_unsigned_int_interval(0, 4294967295u);
    state.primed = (uint8_t)Frama_C_interval(0, 255);
    state.outliers = (uint8_t)Frama_C_interval(0, 255);
    for (int j = 0; j < FSW_MAX_INPUTS; j++) state.wait[j] = Frama_C_unsigned_int_interval(0, 4294967295u);
    for (int i = 0; i < FSW_MAX_LINE; i++) state.line[i] = (uint8_t)Frama_C_interval(0, controller.level_count[0] - 1);

    many(x, FSW_MAX_STATES);
    many(reference, FSW_MAX_OUTPUTS * FSW_ORDER);
    many(w, FSW_MAX_DISTURBANCES);
    for (int i = 0; i < FSW_MAX_LINE; i++) line[i] = (uint8_t)Frama_C_interval(0, 255);
    for (int j = 0; j < FSW_MAX_INPUTS; j++) wait[j] = Frama_C_unsigned_int_interval(0, 4294967295u);
    switch (Frama_C_interval(0, 7)) {
    case 0:
        (void)fsw_preload(&controller, &state, line, wait);
        break;
    case 1:
        (void)fsw_start(&controller, &state, x, w);
        break;
    case 2:
        (void)fsw_decide(&controller, &state, x, reference, w, costs);
        break;
    case 3:
        (void)fsw_track(&controller, &state, Frama_C_interval(0, 1) ? x : 0, w, line);
        break;
    case 4:
        fsw_missed(&controller, &state, (uint16_t)Frama_C_interval(0, 3));
        break;
    case 5:
        fsw_safe(&controller, &state, Frama_C_interval(0, 1) ? x : 0, w, u);
        break;
    case 6: /* one by one: which row it is depends on both */
        for (state.head = 0; state.head < rows; state.head++)
            for (uint16_t age = 1; age <= rows; age++) line[0] = *fsw_issued(&controller, &state, age);
        state.head = 0;
        break;
    default:
        (void)fsw_step(&controller, &state, x, reference, w, u);
        break;
    }
    //@ assert in_the_ring: state.head < rows;
    /*@ assert levels: \forall integer i; 0 <= i < FSW_MAX_LINE ==> state.line[i] < controller.level_count[0]; */
    return 0;
}
