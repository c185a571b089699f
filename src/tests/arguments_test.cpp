#include "app/arguments.hpp"

#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "unlidar/error.hpp"

namespace unlidar {
namespace {

using Words = std::vector<std::string>;

std::optional<std::string> Parse(const Words& words, Arguments* arguments) {
  std::vector<const char*> argv = {"unlidar_track"};
  for (const std::string& word : words) argv.push_back(word.c_str());
  return ParseArguments(static_cast<int>(argv.size()), argv.data(), arguments);
}

Arguments ArgumentsOf(const Words& words) {
  Arguments arguments;
  EXPECT_FALSE(Parse(words, &arguments));
  return arguments;
}

// Why they are refused.
std::string ErrorOf(const Words& words) {
  Arguments arguments;
  try {
    Parse(words, &arguments);
  } catch (const UsageError& error) {
    return error.what();
  }
  return "";
}

TEST(Arguments, SourcesAreFoldersWithANameOrWithout) {
  const Arguments arguments =
      ArgumentsOf({"--frames", "roof=a/b", "--frames", "./c=d", "--frames", "e", "--out", "x.csv"});
  ASSERT_EQ(arguments.sources.size(), 3U);
  EXPECT_EQ(arguments.sources[0].name, "roof");
  EXPECT_EQ(arguments.sources[0].directory, "a/b");
  EXPECT_EQ(arguments.sources[1].name, "");
  EXPECT_EQ(arguments.sources[1].directory, "./c=d");
  EXPECT_EQ(arguments.sources[2].directory, "e");
  EXPECT_EQ(arguments.out, "x.csv");
  EXPECT_FALSE(arguments.is_live());
}

TEST(Arguments, HelpAndVersionAreTextsAndNeedNothingElse) {
  Arguments arguments;
  EXPECT_NE(Parse({"--help"}, &arguments).value_or("").find("--frames"), std::string::npos);
  EXPECT_NE(Parse({"--version"}, &arguments).value_or("").find("unlidar_track"), std::string::npos);
}

TEST(Arguments, ALiveSourceIsOneOfThree) {
  const std::vector<Words> sources = {{"--follow"}, {"--stdin"}, {"--livox", "0.0.0.0:1"}};
  for (std::size_t i = 0; i < sources.size(); ++i) {
    Words words = {"--out", "x"};
    words.insert(words.end(), sources[i].begin(), sources[i].end());
    Words with_folder = words;
    with_folder.insert(with_folder.end(), {"--frames", "a"});
    const bool has_folders = i == 0;
    EXPECT_TRUE(ArgumentsOf(has_folders ? with_folder : words).is_live());
    EXPECT_NE(ErrorOf(has_folders ? words : with_folder).find("--frames"), std::string::npos);
    for (std::size_t k = 0; k < sources.size(); ++k) {
      Words both = words;
      both.insert(both.end(), sources[k].begin(), sources[k].end());
      if (k != i) {
        EXPECT_NE(ErrorOf(both).find("excludes"), std::string::npos);
      }
    }
  }
}

TEST(Arguments, WhatNeedsTheWholeRecordingIsRefusedLive) {
  const std::vector<Words> whole = {
      {"--at", "a"}, {"--clusters", "c"}, {"--points", "p"}, {"--format", "tum"}};
  for (const Words& option : whole) {
    Words words = {"--frames", "a", "--out", "x"};
    words.insert(words.end(), option.begin(), option.end());
    EXPECT_EQ(ErrorOf(words), "");
    words.emplace_back("--follow");
    EXPECT_NE(ErrorOf(words).find(option[0] + " " + option[1] + ": not with --follow"),
              std::string::npos);
  }
  EXPECT_EQ(ErrorOf({"--stdin", "--out", "x", "--trace", "t"}), "");
  for (const std::string option : {"--trace", "--state", "--metrics"}) {
    EXPECT_NE(ErrorOf({"--stdin", "--out", "x", option, "-"}).find(option + " -: not with --stdin"),
              std::string::npos);
  }
  EXPECT_NE(ErrorOf({"--frames", "a", "--out", "x", "--events", "e"}).find("--events e"),
            std::string::npos);
}

TEST(Arguments, FoldersAndNamesAreGivenOnce) {
  const auto refused = [](const char* a, const char* b) {
    return ErrorOf({"--frames", a, "--frames", b, "--out", "x"});
  };
  EXPECT_EQ(refused("roof=a", "mast=b"), "");
  EXPECT_NE(refused("roof=a", "roof=b").find("both named 'roof'"), std::string::npos);
  EXPECT_NE(refused("roof=a", "mast=./a").find("given twice"), std::string::npos);
  EXPECT_NE(refused("roof=a", "mast=").find("expected a directory"), std::string::npos);
  EXPECT_NE(refused("roof=a", "m.t=b").find("expected a name"), std::string::npos);
}

TEST(Arguments, CapturesOfPacketsAreBoundedAndOfLivoxOnly) {
  const Words livox = {"--livox", "0.0.0.0:1", "--out", "x", "--record-packets", "d"};
  const auto with = [&](const Words& more) {
    Words words = livox;
    words.insert(words.end(), more.begin(), more.end());
    return words;
  };
  EXPECT_EQ(ArgumentsOf(livox).capture_file_bytes(), ArgumentsOf(livox).record_packets_bytes / 40);
  EXPECT_EQ(ArgumentsOf(with({"--record-packets-bytes", "1500MB"})).record_packets_bytes,
            1'500'000'000U);
  EXPECT_EQ(ArgumentsOf(with({"--record-packets-bytes", "4MB"})).capture_file_bytes(), 1'000'000U);
  EXPECT_EQ(ArgumentsOf(with({"--record-packets-file-bytes", "2MiB"})).capture_file_bytes(),
            std::uint64_t{2} << 20U);
  for (const char* bytes :
       {"1999999", "0", "-5", "nan", "inf", "1.5GB", "4 furlongs", "1e30", ""}) {
    EXPECT_NE(ErrorOf(with({std::string("--record-packets-bytes=") + bytes})), "") << bytes;
  }
  for (const char* bytes : {"-1", "99999999999999999999"}) {
    const std::string error = ErrorOf(with({"--record-packets-bytes", bytes}));
    EXPECT_NE(error.find("'" + std::string(bytes) + "', expected bytes"), std::string::npos)
        << error;
  }
  EXPECT_NE(ErrorOf(with({"--record-packets-file-bytes", "2GB", "--record-packets-bytes", "3GB"})),
            "");
  EXPECT_NE(ErrorOf({"--stdin", "--out", "x", "--record-packets", "d"}), "");
  EXPECT_NE(ErrorOf({"--livox", "0.0.0.0:1", "--out", "x", "--record-packets-bytes", "4GB"}), "");
  EXPECT_NE(ErrorOf({"--livox", "0.0.0.0:1", "--out", "x", "--record-packets", ""}), "");
}

}  // namespace
}  // namespace unlidar
