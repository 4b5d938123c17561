/* A rounded value: volatile keeps the compiler from contracting its product into a sum. */
INLINE lanes lanes_rounded(lanes value)
{
    volatile lanes kept = value;
    return kept;
}
