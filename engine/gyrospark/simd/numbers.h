/* NUMBER and TYPED for scalars: later headers are compiled for real. */
#if !GS_PROFILE_CONTROL
#undef NUMBER
#undef TYPED
#endif
#undef GS_ON_DUALS
#define NUMBER real
#define TYPED(f) f
