// LibLZF's format, which binary_compressed PCD files use.
#pragma once

#include <cstddef>
#include <cstdint>

namespace unlidar {

// No LZF stream expands further: three bytes make at most 264.
inline constexpr std::size_t kLzfMaxExpansion = 88;

// True if the stream is sound and fills the output to its last byte. Reads and writes nothing
// outside of the two ranges, whatever the stream says.
bool LzfDecompress(const std::uint8_t* in, std::size_t in_size, std::uint8_t* out,
                   std::size_t out_size);

}  // namespace unlidar
