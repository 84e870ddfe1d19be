// A right table of a made-up integrand: c++ -O2 demo.cpp -o demo && ./demo table.npz && python -m dmis doctor table.npz
#include "dmis_samples.h"

#include <cmath>
#include <random>

int main(int, char** arguments) {
  std::mt19937 generator(1);
  std::uniform_real_distribution<float> uniform(0, 1);
  dmis_samples::Table table(1, 1);
  for (int i = 0; i < 20000; i++) {
    for (int8_t technique = 0; technique < 2; technique++) {  // the cosine x has p_l = 2 (1 - x) and p_b = 2 x
      float u = std::sqrt(uniform(generator)), x = technique ? u : 1 - u, sine = std::sqrt(1 - x * x);
      float f = uniform(generator) < .7f ? 1 + x : 0;  // 0 where the light is occluded
      table.add({i % 100, i / 100, technique, {f, f, f}, 2 * (1 - x), 2 * x, 0, 0,
                 {sine, 0, x}, {0, 0, 1}, {0, 0, 1}, {-sine, 0, -x}, 1});
    }
  }
  table.write(arguments[1]);
}
