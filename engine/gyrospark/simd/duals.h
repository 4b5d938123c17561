/* NUMBER and TYPED for dual numbers: later headers are compiled for them. */
#undef NUMBER
#undef TYPED
#define NUMBER dual
#define TYPED(f) dual_##f
#define GS_ON_DUALS 1
