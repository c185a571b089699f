// Numbers and values of the user as text, the same in every locale.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>

namespace unlidar {

// With so many digits behind the point; "nan" where the value is not finite, never "-0.000".
std::string FixedText(double value, int digits);

// The shortest text that reads back as the value.
std::string ShortestText(double value);

// Text of unknown origin for a message: one line, printable (other bytes become '?'), and not
// endless: the first bytes and "..." where it is longer.
std::string Shortened(std::string_view text, std::size_t max_bytes = 80);

// The same in single quotes.
std::string Quoted(std::string_view text);

// "1 frame", "2 frames".
std::string Count(std::size_t count, const std::string& noun);

}  // namespace unlidar
