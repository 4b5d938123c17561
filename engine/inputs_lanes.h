/* The inputs of the next step of each trajectory; lanes beyond the last repeat the first. */
static void take_lane_inputs(batch_t *b, const inputs_t *inputs, int count)
{
    constants c;
    for (int i = 0; i < LANES && inputs->values != NULL; ++i) {
        take_inputs(&c, inputs, i < count ? i : 0, b->done);
        lanes_set_inputs(&b->run.constants, i, &c);
    }
}
