/* There is no constraint that a drive could move. */
INLINE lanes RUN(drive_of_constraints)(const RUN(t) *w, const lanes *q_mean)
{
    (void)w, (void)q_mean;
    return splat(0);
}
