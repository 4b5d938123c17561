/* NUMBER and TYPED for scalars: later headers are compiled for real. */
#undef NUMBER
#undef TYPED
#undef GS_ON_DUALS
#define NUMBER real
#define TYPED(f) f
