/* NUMBER and TYPED for scalars: later headers are compiled for real. */
#undef NUMBER
#undef TYPED
#define NUMBER real
#define TYPED(f) f
