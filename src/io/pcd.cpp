#include "io/pcd.hpp"

#include <algorithm>
#include <array>
#include <cstring>
#include <limits>
#include <memory>

#include "base/algorithms.hpp"
#include "io/input_file.hpp"
#include "io/pcd_format.hpp"
#include "unlidar/error.hpp"

static_assert(sizeof(Eigen::Vector3f) == 12, "points are written as they lie in memory");

namespace unlidar {
namespace {

// Larger than any LiDAR frame, in the file or unpacked.
constexpr std::uint64_t kMaxFrameBytes = std::uint64_t{1} << 30;
constexpr std::size_t kCompressedPrefix = 8;  // two sizes before compressed data

// Values of a field in memory, one every `stride` bytes.
struct Column {
  const std::uint8_t* data = nullptr;
  std::size_t stride = 0;
};

// Apart from its caller, where a signed char that is widened looks like a character.
template <typename Source, typename Target>
Target Converted(Source value) {
  if constexpr (std::is_same_v<Source, std::uint64_t> && std::is_same_v<Target, std::int64_t>) {
    value = std::min<Source>(value, std::numeric_limits<Target>::max());
  }
  return static_cast<Target>(value);
}

template <typename Source, typename Target>
void CopyColumnAs(Column column, std::size_t count, Target* to, std::size_t to_stride) {
  for (std::size_t i = 0; i < count; ++i) {
    const auto value = LoadAs<Source>(column.data + i * column.stride);
    to[i * to_stride] = Converted<Source, Target>(value);
  }
}

template <typename Target>
void CopyColumn(Column column, PcdType type, std::size_t count, Target* to, std::size_t to_stride) {
  using Copy = void (*)(Column, std::size_t, Target*, std::size_t);
  constexpr std::array<Copy, 10> kCopies = {// by type
                                            CopyColumnAs<std::int8_t>,  CopyColumnAs<std::uint8_t>,
                                            CopyColumnAs<std::int16_t>, CopyColumnAs<std::uint16_t>,
                                            CopyColumnAs<std::int32_t>, CopyColumnAs<std::uint32_t>,
                                            CopyColumnAs<std::int64_t>, CopyColumnAs<std::uint64_t>,
                                            CopyColumnAs<float>,        CopyColumnAs<double>};
  kCopies[static_cast<std::size_t>(type)](column, count, to, to_stride);
}

// `column_of` returns the Column of a field.
template <typename ColumnOf>
PcdCloud CloudOf(const PcdHeader& header, const ColumnOf& column_of) {
  PcdCloud cloud = EmptyCloud(header);
  const std::size_t count = header.num_points;
  if (count == 0) return cloud;
  for (std::size_t axis = 0; axis < header.field_of.size(); ++axis) {
    const std::size_t field = header.field_of[axis];
    if (field == kNoField) continue;
    const PcdType type = header.fields[field].type;
    if (axis != PcdHeader::kTime) {
      CopyColumn(column_of(field), type, count, cloud.points_m.front().data() + axis, 3);
    } else if (cloud.floating_times.empty()) {
      CopyColumn(column_of(field), type, count, cloud.integer_times.data(), 1);
    } else {
      CopyColumn(column_of(field), type, count, cloud.floating_times.data(), 1);
    }
  }
  return cloud;
}

const std::uint8_t* Bytes(std::string_view text) {
  return reinterpret_cast<const std::uint8_t*>(text.data());
}

PcdCloud ParseBinary(std::string_view body, const PcdHeader& header, const std::string& name) {
  const std::uint64_t expected = header.num_points * header.row_bytes;
  if (body.size() < expected) {
    throw InputError(name + ": the data has " + std::to_string(body.size()) + " bytes, expected " +
                     std::to_string(expected) + " for " + std::to_string(header.num_points) +
                     " points");
  }
  return CloudOf(header, [&](std::size_t field) {
    return Column{Bytes(body) + header.fields[field].byte_offset, header.row_bytes};
  });
}

// Two sizes, then an LZF stream of all values of the first field, all of the second, and so on. PCL
// omits padding, other writers keep it; the size shows which.
PcdCloud ParseCompressed(std::string_view body, const PcdHeader& header, const std::string& name) {
  if (header.num_points == 0) return EmptyCloud(header);
  const auto fail = [&](const std::string& what) {
    throw InputError(name + ": compressed data " + what);
  };
  if (body.size() < kCompressedPrefix) {
    fail("has " + std::to_string(body.size()) + " bytes, expected two sizes of 4 bytes first");
  }
  const auto compressed_size = LoadAs<std::uint32_t>(body.data());
  const auto size = LoadAs<std::uint32_t>(body.data() + 4);
  body.remove_prefix(kCompressedPrefix);
  if (compressed_size > body.size()) {
    fail("says it has " + std::to_string(compressed_size) + " bytes, expected at most the " +
         std::to_string(body.size()) + " that are left in the file");
  }

  std::uint64_t padding_bytes = 0;
  for (const PcdField& field : header.fields) {
    if (field.is_padding()) padding_bytes += field.size_bytes();
  }
  const std::uint64_t full_size = header.num_points * header.row_bytes;
  const std::uint64_t lean_size = header.num_points * (header.row_bytes - padding_bytes);
  if (size != full_size && size != lean_size) {
    fail("says it unpacks to " + std::to_string(size) + " bytes, expected " +
         std::to_string(full_size) + " for " + std::to_string(header.num_points) + " points");
  }
  if (size > kMaxFrameBytes) {
    fail("unpacks to " + std::to_string(size) + " bytes, expected at most " +
         std::to_string(kMaxFrameBytes) + " of a frame");
  }
  if (size / kLzfMaxExpansion > compressed_size) {
    fail("says that " + std::to_string(compressed_size) + " bytes unpack to " +
         std::to_string(size) + ", expected at most " + std::to_string(kLzfMaxExpansion) +
         " times as much");
  }

  // Plain new leaves the bytes uninitialised: LzfDecompress writes each of them or fails.
  const std::unique_ptr<std::uint8_t[]> unpacked(new std::uint8_t[size]);
  if (!LzfDecompress(Bytes(body), compressed_size, unpacked.get(), size)) {
    fail("of " + std::to_string(compressed_size) + " bytes is corrupt, expected an LZF stream of " +
         std::to_string(size) + " bytes");
  }
  const bool has_padding = size == full_size;
  return CloudOf(header, [&](std::size_t wanted) {
    std::uint64_t bytes_before = 0;
    for (std::size_t i = 0; i < wanted; ++i) {
      const PcdField& field = header.fields[i];
      if (has_padding || !field.is_padding()) bytes_before += field.size_bytes();
    }
    return Column{unpacked.get() + bytes_before * header.num_points,
                  header.fields[wanted].size_bytes()};
  });
}

// Returns the end of the last point, from the header and, for compressed data, the first of the
// sizes after it; for text, the end of the file.
std::uint64_t BytesNeeded(const PcdHeader& header, std::string_view bytes,
                          std::uint64_t file_bytes) {
  if (header.encoding == PcdEncoding::kAscii) return file_bytes;
  if (header.encoding == PcdEncoding::kBinary) {
    return header.body_begin + header.num_points * header.row_bytes;
  }
  if (bytes.size() < header.body_begin + kCompressedPrefix) return bytes.size();
  return header.body_begin + kCompressedPrefix +
         LoadAs<std::uint32_t>(bytes.data() + header.body_begin);
}

PcdCloud ParseBody(std::string_view bytes, const PcdHeader& header, const std::string& name) {
  if (header.encoding == PcdEncoding::kAscii) return ParsePcdAscii(bytes, header, name);
  const auto parse = header.encoding == PcdEncoding::kBinary ? ParseBinary : ParseCompressed;
  return parse(bytes.substr(header.body_begin), header, name);
}

}  // namespace

PcdCloud EmptyCloud(const PcdHeader& header) {
  PcdCloud cloud;
  cloud.points_m.resize(header.num_points);
  if (header.field_of[2] == kNoField) {
    for (Eigen::Vector3f& point : cloud.points_m) point.z() = 0.0F;
  }
  const std::size_t time = header.field_of[PcdHeader::kTime];
  if (time == kNoField) return cloud;
  if (IsFloating(header.fields[time].type)) {
    cloud.floating_times.resize(header.num_points);
  } else {
    cloud.integer_times.resize(header.num_points);
  }
  return cloud;
}

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

PcdCloud ParsePcd(std::string_view bytes, const std::string& name) {
  return ParseBody(bytes, ParsePcdHeader(bytes, name), name);
}

// Read, not mapped: a mapped file that shrinks kills the process.
PcdCloud ReadPcd(const std::string& path) {
  InputFile file(path, {"a PCD file", true});
  // Holds most frames in full, and always the header and the size of the data after it.
  std::uint64_t size = std::min<std::uint64_t>(file.size(), kMaxPcdHeaderBytes + kCompressedPrefix);
  std::unique_ptr<char[]> bytes(new char[size]);
  size = file.Read(bytes.get(), size);
  const PcdHeader header = ParsePcdHeader({bytes.get(), size}, path);

  const std::uint64_t needed =
      std::min(BytesNeeded(header, {bytes.get(), size}, file.size()), file.size());
  if (needed > kMaxFrameBytes) {
    throw InputError(path + ": takes " + std::to_string(needed) + " bytes, expected at most " +
                     std::to_string(kMaxFrameBytes) + " of a frame");
  }
  if (needed > size) {
    std::unique_ptr<char[]> whole(new char[needed]);
    std::memcpy(whole.get(), bytes.get(), size);
    size += file.Read(whole.get() + size, needed - size);
    bytes = std::move(whole);
  }
  return ParseBody({bytes.get(), size}, header, path);
}

std::string BinaryPcd(const std::vector<Eigen::Vector3f>& points_m) {
  const std::string count = std::to_string(points_m.size());
  std::string bytes =
      "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\n"
      "TYPE F F F\nCOUNT 1 1 1\nWIDTH " +
      count + "\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS " + count + "\nDATA binary\n";
  if (!points_m.empty()) {
    bytes.append(reinterpret_cast<const char*>(points_m.data()), 12 * points_m.size());
  }
  return bytes;
}

}  // namespace unlidar
