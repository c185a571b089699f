// Any stream into any room: what the plainest reading of the format gives, and no byte outside.
#include <optional>
#include <vector>

#include "fuzz/fuzz.hpp"
#include "io/pcd_format.hpp"

namespace unlidar::fuzz {
namespace {

// The format token by token; what a stream gives however little room there is for it. Empty for one
// that breaks off or points before its begin.
std::optional<std::vector<std::uint8_t>> Unpacked(ByteReader stream) {
  std::vector<std::uint8_t> out;
  while (!stream.empty()) {
    const std::size_t control = stream.Byte();
    if (control < 32) {
      for (std::size_t i = 0; i <= control; ++i) {
        if (stream.empty()) return std::nullopt;
        out.push_back(stream.Byte());
      }
      continue;
    }
    std::size_t length = control / 32 + 2;
    if (length == 9) {
      if (stream.empty()) return std::nullopt;
      length += stream.Byte();
    }
    if (stream.empty()) return std::nullopt;
    const std::size_t distance = control % 32 * 256 + stream.Byte() + 1;
    if (distance > out.size()) return std::nullopt;
    for (std::size_t i = 0; i < length; ++i) out.push_back(out[out.size() - distance]);
  }
  return out;
}

void Run(std::string_view bytes) {
  ByteReader reader(bytes);
  const std::size_t asked = reader.Byte() + std::size_t{256} * reader.Byte();
  const std::string_view stream = bytes.substr(std::min<std::size_t>(bytes.size(), 2));
  const auto expected = Unpacked(ByteReader(stream));

  // Copies of exactly the size: the sanitizer watches both ends of both.
  const std::vector<std::uint8_t> in(stream.begin(), stream.end());
  const auto unpack = [&](std::size_t room) {
    std::vector<std::uint8_t> out(room);
    const bool sound = LzfDecompress(in.data(), in.size(), out.data(), out.size());
    Require(sound == (expected && expected->size() == room),
            "a stream unpacks if it is sound and fills the room");
    Require(!sound || out == *expected, "a stream gives what its tokens say");
  };
  unpack(asked);
  if (!expected) return;
  Require(expected->size() <= kLzfMaxExpansion * in.size(), "no stream expands further");
  unpack(expected->size());
}

}  // namespace
}  // namespace unlidar::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  unlidar::fuzz::Run(unlidar::fuzz::Text(data, size));
  return 0;
}
