/* NUMBER and TYPED for vectors: later headers are compiled for lanes. */
#undef NUMBER
#undef TYPED
#define NUMBER lanes
#define TYPED(f) lanes_##f
