// Shared by the parts of the PCD reader: the checked header and the decoders.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "io/pcd.hpp"

namespace unlidar {

enum class PcdEncoding { kAscii, kBinary, kBinaryCompressed };
enum class PcdType { kI8, kU8, kI16, kU16, kI32, kU32, kI64, kU64, kF32, kF64 };

inline bool IsFloating(PcdType type) { return type == PcdType::kF32 || type == PcdType::kF64; }
std::size_t SizeBytes(PcdType type);

struct PcdField {
  std::string name;
  PcdType type = PcdType::kF32;
  std::uint64_t count = 1;
  std::uint64_t byte_offset = 0;   // of the first value, in a row of binary data
  std::uint64_t value_offset = 0;  // the same in values, for ascii

  std::uint64_t size_bytes() const { return count * SizeBytes(type); }  // of all its values
  bool is_padding() const { return name == "_"; }
};

// Maximum size of a header, so that a large file of another kind is rejected early.
inline constexpr std::size_t kMaxPcdHeaderBytes = std::size_t{1} << 20;

inline constexpr std::size_t kNoField = static_cast<std::size_t>(-1);

struct PcdHeader {
  std::vector<PcdField> fields;
  std::uint64_t num_points = 0;
  std::uint64_t row_bytes = 0;   // row_bytes * num_points is below 2^57
  std::uint64_t row_values = 0;  // values on a line of ascii data
  PcdEncoding encoding = PcdEncoding::kAscii;
  std::size_t body_begin = 0;  // first byte after the DATA line
  std::size_t body_line = 0;   // line number of that byte, from 1

  // Indices into `fields` of x, y, z and, at kTime, the time; z and time may be kNoField.
  std::array<std::size_t, 4> field_of = {kNoField, kNoField, kNoField, kNoField};
  static constexpr std::size_t kTime = 3;
};

// Returns a header that is consistent in itself; the body remains to be checked. Throws InputError.
PcdHeader ParsePcdHeader(std::string_view bytes, const std::string& name);

// Reads header.num_points lines of text, each with header.row_values values.
PcdCloud ParsePcdAscii(std::string_view bytes, const PcdHeader& header, const std::string& name);

// Largest expansion of an LZF stream, as in binary_compressed files: three bytes make at most 264.
inline constexpr std::size_t kLzfMaxExpansion = 88;

// Returns true if the stream, in the LZF format of LibLZF, is valid and fills the output to its
// last byte. Never accesses memory outside the two ranges, whatever the stream contains.
bool LzfDecompress(const std::uint8_t* in, std::size_t in_size, std::uint8_t* out,
                   std::size_t out_size);

// Returns a cloud of header.num_points points, with times if the header has them; z is 0 if it has
// no z, all other values are to be filled in.
PcdCloud EmptyCloud(const PcdHeader& header);

}  // namespace unlidar
