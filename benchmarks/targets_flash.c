/* The smallest program with a controller; with -DWITHOUT the same without. Their difference is what the controller
 * takes of flash and memory, library routines included. */
#include "foreswitch_design.h"
#include "port.h"

int main(void)
{
    static fsw_real x[16], reference[64], w[16], u[16];
    port_read(x, sizeof x);
    port_read(reference, sizeof reference);
    port_read(w, sizeof w);
#ifndef WITHOUT
    static fsw_state state;
    if (fsw_init(&controller, &state) != FSW_VALID) return 1;
    (void)fsw_step(&controller, &state, x, reference, w, u);
#endif
    port_write(u, sizeof u);
    return 0;
}
