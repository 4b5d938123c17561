/* What the sketch needs of Arduino, on a computer: to compile it there and compare its bits. */
#ifndef ARDUINO_SHIM_H
#define ARDUINO_SHIM_H

#include <stdio.h>
#include <time.h>

inline unsigned long micros()
{
    return (unsigned long)(1e6*(double)clock()/(double)CLOCKS_PER_SEC);
}

struct SerialPort {
    void begin(long) {}
    void print(unsigned long x) { fprintf(stderr, "%lu", x); }
    void print(const char *text) { fprintf(stderr, "%s", text); }
    void println(const char *text) { fprintf(stderr, "%s\n", text); }
    void println(double x, int digits) { fprintf(stderr, "%.*f\n", digits, x); }
};
static SerialPort Serial;

inline void print_bits(const void *from, size_t size)
{
    for (size_t i = 0; i < size; ++i)
        printf("%02x", static_cast<const unsigned char *>(from)[i]);
}

#endif
