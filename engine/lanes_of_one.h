/* -------------------------------------------------------------------------- lanes: there is one */

/* No machine has vector registers for this type. */
typedef real lanes;
