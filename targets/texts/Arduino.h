/* What the sketch needs of Arduino, on a computer: to compile it there and compare its bits. */
#ifndef ARDUINO_SHIM_H
#define ARDUINO_SHIM_H

#include <chrono>
#include <cstdio>
#include <cstring>

inline unsigned long micros()
{
    using namespace std::chrono;
    return (unsigned long)duration_cast<microseconds>(steady_clock::now().time_since_epoch()).count();
}

struct SerialPort {
    void begin(long) {}
    void print(unsigned long x) { std::fprintf(stderr, "%lu", x); }
    void print(const char *text) { std::fprintf(stderr, "%s", text); }
    void println(const char *text) { std::fprintf(stderr, "%s\n", text); }
    void println(double x, int digits) { std::fprintf(stderr, "%.*f\n", digits, x); }
};
static SerialPort Serial;

inline void print_bits(const void *from, std::size_t size)
{
    for (std::size_t i = 0; i < size; ++i)
        std::printf("%02x", static_cast<const unsigned char *>(from)[i]);
}

#endif
