// SPDX-FileCopyrightText: 2026 The terrain_estimator authors
// SPDX-License-Identifier: Apache-2.0
//
// Compares a core with what TorchScript answered when it was exported, and prints a checksum of all
// numbers of the recorded drive, which is the same on every processor.

#include <cstdio>
#include <cstring>
#include <vector>

#include "terrain_core.h"

int main() {
  int64_t observations, size;
  const double* drive = terrain_drive(&observations, &size);
  uint64_t checksum = 14695981039346656037ull;  // FNV-1a
  std::vector<double> numbers(1 << 20);
  TerrainState* state = terrain_initial();
  for (int64_t k = 0; state && k < observations; ++k) {
    TerrainState* after = terrain_update(state, drive + k * size, size);
    terrain_free(state);
    state = after;
    for (int64_t key = 0; state && terrain_name(key); ++key) {
      const int64_t count =
          terrain_read(state, &key, 1, numbers.data(), static_cast<int64_t>(numbers.size()));
      for (int64_t n = 0; n < count; ++n) {
        uint64_t bits;
        const double value = numbers[n] == numbers[n] ? numbers[n] : 0.0;  // any NaN is NaN
        std::memcpy(&bits, &value, 8);
        checksum = (checksum ^ bits) * 1099511628211ull;
      }
    }
  }
  const double difference = terrain_check();
  std::printf("model %.16s, checksum %016llx, largest difference %.3g posterior deviations\n",
              terrain_model(), static_cast<unsigned long long>(checksum), difference);
  terrain_free(state);
  return state && difference <= 1e-9 ? 0 : 1;
}
