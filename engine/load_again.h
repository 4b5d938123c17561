/* Keeps the compiler from holding more values in registers than there are, and spilling them. */
#if defined(__GNUC__)
#define LOAD_AGAIN(pointer) __asm__("" : "+r"(pointer))
#else
#define LOAD_AGAIN(pointer) (void)(pointer)
#endif
