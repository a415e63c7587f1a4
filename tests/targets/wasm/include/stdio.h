/* There is no C library for this target: as much as the self-test of an export asks for. */
int putchar(int c);
