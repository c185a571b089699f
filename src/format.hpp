// Numbers as text, the same in every locale.
#pragma once

#include <cstddef>
#include <string>

namespace unlidar {

// With so many digits behind the point; "nan" where the value is not finite, never "-0.000".
std::string FixedText(double value, int digits);

// The shortest text that reads back as the value.
std::string ShortestText(double value);

// "1 frame", "2 frames".
std::string Count(std::size_t count, const std::string& noun);

}  // namespace unlidar
