// LZF format of LibLZF, as in binary_compressed PCD files.
#pragma once

#include <cstddef>
#include <cstdint>

namespace unlidar {

// Largest expansion of an LZF stream: three bytes make at most 264.
inline constexpr std::size_t kLzfMaxExpansion = 88;

// Returns true if the stream is valid and fills the output to its last byte. Never accesses memory
// outside the two ranges, whatever the stream contains.
bool LzfDecompress(const std::uint8_t* in, std::size_t in_size, std::uint8_t* out,
                   std::size_t out_size);

}  // namespace unlidar
