// 2000 steps from the start of the model.
//     cmake -B build && cmake --build build && build/wheeled_satellite_gl2_gamma
#include "wheeled_satellite_gl2_gamma.hpp"

#include <cstdio>

int main(int count, char **)
{
    WheeledSatellite stepper, start = stepper;
    for (int k = 1; k <= 2000; ++k)
        if (const auto status = stepper.advance(); status > 1) {
            std::printf("step %d failed with status %d: choose a smaller dt\n", k, int(status));
            return 1;
        }
    if (count > 1) { // any argument: the bits, to compare
        for (const auto *state : { &stepper.q, &stepper.p })
            for (std::size_t i = 0; i < sizeof *state; ++i)
                std::printf("%02x", unsigned(reinterpret_cast<const unsigned char *>(state)[i]));
        std::putchar('\n');
        return 0;
    }
    for (std::size_t i = 0; i < stepper.q.size(); ++i)
        std::printf("q%zu: %.9g -> %.9g\n", i, double(start.q[i]), double(stepper.q[i]));
    std::printf("H: %.9g, changed by %.1e\n", double(start.energy()),
        double(stepper.energy() - start.energy()));
}
