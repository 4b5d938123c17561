/* Headers that are included after this one work on lanes. */
#undef NUMBER
#undef TYPED
#define NUMBER lanes
#define TYPED(f) lanes_##f
