// Test-only: PCD files with any fields in any encoding, and their true values.
#pragma once

#include <pcl/io/lzf.h>

#include <cstdint>
#include <cstring>
#include <limits>
#include <sstream>
#include <string>
#include <vector>

namespace unlidar::testing {

struct FieldSpec {
  std::string name;
  char type = 'F';
  int size = 4;
  int count = 1;
};

// values[row][k] are the values of a row, field by field, `count` of them each.
struct TestCloud {
  std::vector<FieldSpec> fields;
  std::vector<std::vector<double>> values;
};

enum class TestEncoding { kAscii, kBinary, kCompressed, kCompressedWithPadding };

template <typename T>
void Append(double value, std::string& bytes) {
  const T converted = static_cast<T>(value);
  char raw[sizeof(T)];
  std::memcpy(raw, &converted, sizeof(T));
  bytes.append(raw, sizeof(T));
}

inline void AppendValue(const FieldSpec& field, double value, std::string& bytes) {
  const bool is_signed = field.type == 'I';
  if (field.type == 'F') {
    return field.size == 4 ? Append<float>(value, bytes) : Append<double>(value, bytes);
  }
  switch (field.size) {
    case 1:
      return is_signed ? Append<std::int8_t>(value, bytes) : Append<std::uint8_t>(value, bytes);
    case 2:
      return is_signed ? Append<std::int16_t>(value, bytes) : Append<std::uint16_t>(value, bytes);
    case 4:
      return is_signed ? Append<std::int32_t>(value, bytes) : Append<std::uint32_t>(value, bytes);
    default:
      return is_signed ? Append<std::int64_t>(value, bytes) : Append<std::uint64_t>(value, bytes);
  }
}

inline std::string HeaderOf(const TestCloud& cloud, const std::string& encoding) {
  std::ostringstream header;
  header << "# comment\nVERSION 0.7\nFIELDS";
  for (const FieldSpec& field : cloud.fields) header << ' ' << field.name;
  header << "\nSIZE";
  for (const FieldSpec& field : cloud.fields) header << ' ' << field.size;
  header << "\nTYPE";
  for (const FieldSpec& field : cloud.fields) header << ' ' << field.type;
  header << "\nCOUNT";
  for (const FieldSpec& field : cloud.fields) header << ' ' << field.count;
  header << "\nWIDTH " << cloud.values.size() << "\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS "
         << cloud.values.size() << "\nDATA " << encoding << '\n';
  return header.str();
}

inline std::string Compressed(const std::string& bytes) {
  std::string packed(2 * bytes.size() + 1024, '\0');
  const std::uint32_t packed_size =
      pcl::lzfCompress(bytes.data(), static_cast<unsigned int>(bytes.size()), packed.data(),
                       static_cast<unsigned int>(packed.size()));
  packed.resize(packed_size);
  return packed;
}

inline std::string WithSizes(const std::string& packed, std::size_t unpacked_size) {
  std::string bytes;
  Append<std::uint32_t>(static_cast<double>(packed.size()), bytes);
  Append<std::uint32_t>(static_cast<double>(unpacked_size), bytes);
  return bytes + packed;
}

inline std::string Encoded(const TestCloud& cloud, TestEncoding encoding) {
  if (encoding == TestEncoding::kAscii) {
    std::ostringstream text;
    text.precision(std::numeric_limits<double>::max_digits10);
    for (const std::vector<double>& row : cloud.values) {
      for (std::size_t k = 0; k < row.size(); ++k) text << (k == 0 ? "" : " ") << row[k];
      text << '\n';
    }
    return HeaderOf(cloud, "ascii") + text.str();
  }
  std::string bytes;
  if (encoding == TestEncoding::kBinary) {
    for (const std::vector<double>& row : cloud.values) {
      std::size_t k = 0;
      for (const FieldSpec& field : cloud.fields) {
        for (int i = 0; i < field.count; ++i) AppendValue(field, row[k++], bytes);
      }
    }
    return HeaderOf(cloud, "binary") + bytes;
  }
  std::size_t first = 0;
  for (const FieldSpec& field : cloud.fields) {
    const std::size_t begin = first;
    first += static_cast<std::size_t>(field.count);
    if (field.name == "_" && encoding == TestEncoding::kCompressed) continue;
    for (const std::vector<double>& row : cloud.values) {
      for (std::size_t k = begin; k < first; ++k) AppendValue(field, row[k], bytes);
    }
  }
  return HeaderOf(cloud, "binary_compressed") + WithSizes(Compressed(bytes), bytes.size());
}

}  // namespace unlidar::testing
