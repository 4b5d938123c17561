/* A rounded value: keeps the compiler from contracting its product into a sum. */
INLINE lanes lanes_rounded(lanes value)
{
#if defined(__GNUC__) && defined(__AVX512F__)
    __asm__("" : "+v"(value));
    return value;
#elif defined(__GNUC__) && defined(__SSE2__)
    __asm__("" : "+x"(value));
    return value;
#elif defined(__GNUC__) && defined(__aarch64__)
    __asm__("" : "+w"(value));
    return value;
#else
    volatile lanes kept = value;
    return kept;
#endif
}
