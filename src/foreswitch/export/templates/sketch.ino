// @title@. Replace measure(), wanted() and the pins by your own.
#include <foreswitch_design.h>

static fsw_state state;
static unsigned long due;

static void measure(fsw_real *x) { for (int i = 0; i < @measured@; i++) x[i] = 0; }
static void wanted(fsw_real *reference) { for (int i = 0; i < @reference@; i++) reference[i] = 0; }

void setup() {
  if (fsw_init(&@name@, &state) != FSW_VALID) for (;;) {}
  due = @clock@();
}

void loop() {
  if ((long)(@clock@() - due) < 0) return;
  due += @ticks@UL;@rounded@
  fsw_real x[@measured@], reference[@reference@], w[@disturbances@] = {0}, u[FSW_MAX_INPUTS];
  measure(x);
  wanted(reference);
  fsw_step(&@name@, &state, x, reference, w, u);
  for (int j = 0; j < FSW_MAX_INPUTS; j++) digitalWrite(2 + j, u[j] != 0 ? HIGH : LOW);
}
