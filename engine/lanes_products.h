/* a b - product, exactly */
INLINE lanes product_error(lanes a, lanes b, lanes product)
{
    lanes error = product;
    for (int i = 0; i < LANES; ++i)
        set_part(&error, i, MATH(fma)(part(&a, i), part(&b, i), -part(&product, i)));
    return error;
}

/* sum += the product of the factors, in twice the working precision (two-product, two-sum). */
INLINE void lanes_add_product(lanes sum[2], int count, const lanes *factors)
{
    lanes high = factors[0], low = splat(0);
    for (int i = 1; i < count; ++i) {
        const lanes product = lanes_rounded(high*factors[i]);
        low = low*factors[i] + product_error(high, factors[i], product);
        high = product;
    }
    const lanes total = sum[0] + high, share = total - sum[0];
    sum[1] += low + ((sum[0] - (total - share)) + (high - share));
    sum[0] = total;
}
