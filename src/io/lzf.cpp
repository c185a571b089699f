#include <cstring>

#include "io/pcd_format.hpp"

namespace unlidar {

// Two kinds of tokens. `000LLLLL`: L + 1 literal bytes follow. `LLLooooo [LLLLLLLL] oooooooo`: copy
// L + 2 bytes that were written o + 1 bytes ago; L = 7 takes the extra length byte. The source may
// overlap the destination, which repeats it.
bool LzfDecompress(const std::uint8_t* in, std::size_t in_size, std::uint8_t* out,
                   std::size_t out_size) {
  std::size_t read = 0;
  std::size_t written = 0;
  while (read < in_size) {
    const std::size_t control = in[read++];
    if (control < 32) {
      const std::size_t length = control + 1;
      if (length > in_size - read || length > out_size - written) return false;
      std::memcpy(out + written, in + read, length);
      read += length;
      written += length;
      continue;
    }
    std::size_t length = control >> 5;
    if (length == 7) {
      if (read == in_size) return false;
      length += in[read++];
    }
    length += 2;
    if (read == in_size) return false;
    const std::size_t distance = ((control & 31) << 8) + in[read++] + 1;
    if (distance > written || length > out_size - written) return false;
    std::uint8_t* const to = out + written;
    const std::uint8_t* const from = to - distance;
    if (distance >= length) {
      std::memcpy(to, from, length);
    } else {
      for (std::size_t i = 0; i < length; ++i) to[i] = from[i];
    }
    written += length;
  }
  return written == out_size;
}

}  // namespace unlidar
