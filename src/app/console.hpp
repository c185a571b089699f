// The lines that the program prints, none of them endless.
#pragma once

#include <string>

namespace unlidar {

// On stdout. Throws OutputError.
void PrintResult(const std::string& text);

// On stderr, behind the name of the program.
void PrintNote(const std::string& text);

}  // namespace unlidar
