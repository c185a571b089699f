#include <algorithm>
#include <array>
#include <cctype>
#include <map>
#include <optional>

#include "base/format.hpp"
#include "io/input_file.hpp"
#include "io/pcd_format.hpp"
#include "unlidar/error.hpp"

namespace unlidar {
namespace {

// Far beyond any sensor; products of row bytes and points still fit into 64 bits.
constexpr std::uint64_t kMaxRowBytes = std::uint64_t{1} << 31;
constexpr std::uint64_t kMaxPoints = std::uint64_t{1} << 26;
constexpr std::size_t kMaxFields = 4096;

using Tokens = std::vector<std::string_view>;

// The lines before DATA. VIEWPOINT is a pose, not applied, as in PCL.
constexpr std::array<std::string_view, 10> kEntries = {"VERSION", "FIELDS",   "COLUMNS", "SIZE",
                                                       "TYPE",    "COUNT",    "WIDTH",   "HEIGHT",
                                                       "POINTS",  "VIEWPOINT"};

std::string Lower(std::string text) {
  std::transform(text.begin(), text.end(), text.begin(), [](char c) {
    return static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  });
  return text;
}

class HeaderParser {
 public:
  HeaderParser(std::string_view bytes, const std::string& name)
      : bytes_(bytes.substr(0, kMaxPcdHeaderBytes)), name_(name) {}

  PcdHeader Parse() {
    ReadLines();
    CheckVersion();
    ReadFields();
    ReadNumPoints();
    FindFields();
    return header_;
  }

 private:
  [[noreturn]] void Fail(const std::string& what) const {
    throw InputError(name_ + ": PCD header: " + what);
  }

  // Reads the lines up to and including DATA.
  void ReadLines() {
    if (bytes_.empty()) Fail("the file is empty, expected a PCD header");
    std::size_t at = 0;
    for (std::size_t line_number = 1; at < bytes_.size(); ++line_number) {
      const std::size_t newline = bytes_.find('\n', at);
      const std::size_t end = std::min(newline, bytes_.size());
      const Tokens tokens = TokensOf(bytes_.substr(at, end - at), line_number);
      at = newline == std::string_view::npos ? bytes_.size() : newline + 1;
      if (tokens.empty()) continue;
      if (tokens[0] == "DATA") {
        if (at == kMaxPcdHeaderBytes) break;  // the line may be cut off
        ReadEncoding(tokens);
        header_.body_begin = at;
        header_.body_line = line_number + 1;
        return;
      }
      const std::string_view entry = tokens[0] == "COLUMNS" ? "FIELDS" : tokens[0];
      if (!raw_.emplace(entry, Tokens(tokens.begin() + 1, tokens.end())).second) {
        Fail(std::string(tokens[0]) + " appears twice, expected once");
      }
    }
    Fail("has no DATA line, expected DATA ascii, binary or binary_compressed" +
         (bytes_.size() < kMaxPcdHeaderBytes
              ? std::string()
              : " within " + std::to_string(kMaxPcdHeaderBytes) + " bytes"));
  }

  // Returns empty for comments and blank lines.
  Tokens TokensOf(std::string_view line, std::size_t line_number) {
    Tokens tokens = ValuesOf(line);
    if (tokens.empty() || tokens[0].front() == '#') return {};
    if (tokens[0] != "DATA" &&
        std::find(kEntries.begin(), kEntries.end(), tokens[0]) == kEntries.end()) {
      Fail("line " + std::to_string(line_number) + " begins with " + Quoted(tokens[0]) +
           ", expected VERSION, FIELDS, SIZE, TYPE, COUNT, WIDTH, HEIGHT, VIEWPOINT, POINTS or "
           "DATA");
    }
    return tokens;
  }

  // Returns null for an entry that the header does not have.
  const Tokens* Find(std::string_view entry) const {
    const auto found = raw_.find(entry);
    return found == raw_.end() ? nullptr : &found->second;
  }

  void ReadEncoding(const Tokens& tokens) {
    constexpr std::array<std::string_view, 3> kEncodings = {"ascii", "binary", "binary_compressed"};
    const std::string_view value = tokens.size() == 2 ? tokens[1] : std::string_view();
    const auto* const known = std::find(kEncodings.begin(), kEncodings.end(), value);
    if (known == kEncodings.end()) {
      Fail("DATA is " + Quoted(value) + ", expected ascii, binary or binary_compressed");
    }
    header_.encoding = static_cast<PcdEncoding>(known - kEncodings.begin());
  }

  void CheckVersion() const {
    const Tokens* const version = Find("VERSION");
    if (version == nullptr) return;
    const std::string_view value = version->size() == 1 ? version->front() : std::string_view();
    for (const std::string_view known : {".5", "0.5", ".6", "0.6", ".7", "0.7"}) {
      if (value == known) return;
    }
    Fail("VERSION is " + Quoted(value) + ", expected 0.5, 0.6 or 0.7");
  }

  std::uint64_t Natural(std::string_view text, std::string_view entry) const {
    const auto value = ParseNumber<std::uint32_t>(text);
    if (!value) {
      Fail(std::string(entry) + " is " + Quoted(text) + ", expected a whole number below 2^32");
    }
    return *value;
  }

  std::optional<std::uint64_t> Single(std::string_view entry) const {
    const Tokens* const values = Find(entry);
    if (values == nullptr) return std::nullopt;
    if (values->size() != 1) {
      Fail(std::string(entry) + " has " + std::to_string(values->size()) + " values, expected 1");
    }
    return Natural(values->front(), entry);
  }

  PcdType Type(const PcdField& field, std::string_view type, std::uint64_t size) const {
    constexpr std::string_view kLetters = "IUIUIUIUFF";  // of the types, in their order
    const std::string_view letter = type == "B" && size == 1 ? "U" : type;
    for (std::size_t i = 0; i < kLetters.size(); ++i) {
      const auto known = static_cast<PcdType>(i);
      if (letter == kLetters.substr(i, 1) && size == SizeBytes(known)) return known;
    }
    Fail("field " + Quoted(field.name) + " has TYPE " + Quoted(type) + " and SIZE " +
         std::to_string(size) + ", expected F of 4 or 8, or I or U of 1, 2, 4 or 8 bytes");
  }

  void ReadFields() {
    const Tokens* const names = Find("FIELDS");
    if (names == nullptr || names->empty()) Fail("has no FIELDS, expected at least x and y");
    const std::size_t num_fields = names->size();
    if (num_fields > kMaxFields) {
      Fail("has " + std::to_string(num_fields) + " FIELDS, expected at most " +
           std::to_string(kMaxFields));
    }
    const auto values_of = [&](std::string_view entry, const char* by_default) {
      const Tokens* const values = Find(entry);
      if (values == nullptr) return Tokens(num_fields, by_default);
      if (values->size() == num_fields) return *values;
      Fail(std::string(entry) + " has " + std::to_string(values->size()) +
           " values, expected one for each of the " + std::to_string(num_fields) + " FIELDS");
    };
    const Tokens sizes = values_of("SIZE", "4");
    const Tokens types = values_of("TYPE", "F");
    const Tokens counts = values_of("COUNT", "1");

    for (std::size_t i = 0; i < num_fields; ++i) {
      PcdField field;
      field.name = (*names)[i];
      field.type = Type(field, types[i], Natural(sizes[i], "SIZE"));
      field.count = Natural(counts[i], "COUNT");
      field.byte_offset = header_.row_bytes;
      field.value_offset = header_.row_values;
      header_.row_bytes += field.size_bytes();
      header_.row_values += field.count;
      if (header_.row_bytes > kMaxRowBytes)
        Fail("COUNT makes a row of more than 2^31 bytes, expected less");
      if (field.count > 0) header_.fields.push_back(field);
    }
  }

  void ReadNumPoints() {
    const auto width = Single("WIDTH");
    const auto height = Single("HEIGHT");
    const auto points = Single("POINTS");
    if (!width && !points) Fail("has neither WIDTH nor POINTS, expected the number of points");
    header_.num_points = points ? *points : *width * height.value_or(1);
    const std::uint64_t area = width ? *width * height.value_or(1) : header_.num_points;
    if (area != header_.num_points || header_.num_points > kMaxPoints) {
      Fail("WIDTH x HEIGHT is " + std::to_string(area) + " and POINTS is " +
           std::to_string(header_.num_points) + ", expected the same number, at most " +
           std::to_string(kMaxPoints));
    }
  }

  std::size_t FindField(std::string_view name) const {
    for (std::size_t i = 0; i < header_.fields.size(); ++i) {
      if (header_.fields[i].name == name) return i;
    }
    return kNoField;
  }

  std::size_t FindCoordinate(const char* lower, const char* upper, bool required) const {
    std::size_t found = FindField(lower);
    if (found == kNoField) found = FindField(upper);
    if (found == kNoField && required) {
      std::string names;
      for (const PcdField& field : header_.fields) names += (names.empty() ? "" : " ") + field.name;
      Fail("FIELDS are " + Quoted(names) + ", expected a field " + lower);
    }
    if (found != kNoField && header_.fields[found].count != 1) {
      Fail("field " + Quoted(header_.fields[found].name) + " has COUNT " +
           std::to_string(header_.fields[found].count) + ", expected 1");
    }
    return found;
  }

  void FindFields() {
    header_.field_of = {FindCoordinate("x", "X", true), FindCoordinate("y", "Y", true),
                        FindCoordinate("z", "Z", false), kNoField};
    for (const std::string_view time_name : {"t", "time", "timestamp", "offset_time"}) {
      for (std::size_t i = 0; i < header_.fields.size(); ++i) {
        if (header_.fields[i].count != 1 || Lower(header_.fields[i].name) != time_name) continue;
        header_.field_of[PcdHeader::kTime] = i;
        return;
      }
    }
  }

  std::string_view bytes_;
  const std::string& name_;
  std::map<std::string_view, Tokens> raw_;
  PcdHeader header_;
};

}  // namespace

std::size_t SizeBytes(PcdType type) {
  constexpr std::array<std::size_t, 10> kSizes = {1, 1, 2, 2, 4, 4, 8, 8, 4, 8};
  return kSizes[static_cast<std::size_t>(type)];
}

PcdHeader ParsePcdHeader(std::string_view bytes, const std::string& name) {
  return HeaderParser(bytes, name).Parse();
}

}  // namespace unlidar
