/* What a program on a target may ask of its host. Every target has its own port.c. */
#ifndef PORT_H
#define PORT_H

void port_read(void *to, unsigned size); /* so many bytes of the input; ends the program if there are fewer */
void port_write(const void *from, unsigned size);

#endif
