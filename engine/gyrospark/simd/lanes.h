/* NUMBER and TYPED for vectors: later headers are compiled for lanes. */
#undef NUMBER
#undef TYPED
#undef GS_ON_DUALS
#define NUMBER lanes
#define TYPED(f) lanes_##f
