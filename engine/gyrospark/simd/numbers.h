/* Headers that are included after this one work on numbers. */
#undef NUMBER
#undef TYPED
#define NUMBER real
#define TYPED(f) f
