#include "config/config.hpp"

#include <gtest/gtest.h>
#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <clocale>
#include <cmath>
#include <cstddef>
#include <functional>
#include <set>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "config/config_keys.hpp"
#include "tests/config_entries.hpp"
#include "tests/synthetic_recording.hpp"
#include "tests/temporary_folder.hpp"
#include "unlidar/error.hpp"

namespace unlidar {
namespace {

using ::unlidar::testing::ConfigEntry;
using ::unlidar::testing::ListConfig;
using ::unlidar::testing::Random;
using ::unlidar::testing::TemporaryFolder;

const char* const kDefaultYaml = UNLIDAR_SOURCE_DIR "/configs/default.yaml";

// The one line of the error of this class that an action must throw.
template <class ErrorType>
std::string ReasonOf(const std::function<void()>& action) {
  try {
    action();
  } catch (const ErrorType& error) {
    std::string reason = error.what();
    EXPECT_EQ(reason.find('\n'), std::string::npos) << reason;
    return reason;
  } catch (const std::exception& error) {
    ADD_FAILURE() << "another class of error: " << error.what();
    return "";
  }
  ADD_FAILURE() << "no error";
  return "";
}

std::string ReasonOfFile(const std::string& text) {
  const TemporaryFolder folder;
  const std::string path = folder.Write("c.yaml", text);
  std::string reason = ReasonOf<ConfigError>([&] { LoadConfig(path, {}); });
  EXPECT_EQ(reason.find(path), 0U) << reason;
  return reason.substr(std::min(reason.size(), path.size()));
}

std::string ReasonOfSet(const std::string& assignment) {
  return ReasonOf<ConfigError>([&] { LoadConfig("", {assignment}); });
}

Config FromText(const std::string& text) {
  const TemporaryFolder folder;
  return LoadConfig(folder.Write("c.yaml", text), {});
}

// "key: value" of every key.
std::vector<std::string> Listed(const Config& config) {
  std::vector<std::string> lines;
  for (const ConfigEntry& entry : ListConfig(config)) {
    lines.push_back(entry.key + ": " + entry.value.dump());
  }
  return lines;
}

void CollectKeys(const YAML::Node& node, const std::string& prefix, std::set<std::string>& keys) {
  for (const auto& item : node) {
    const std::string key = prefix + item.first.Scalar();
    if (item.second.IsMap()) {
      CollectKeys(item.second, key + ".", keys);
    } else {
      keys.insert(key);
    }
  }
}

// Converts to any type: T{Anything{}, Anything{}} compiles if T is an aggregate of two fields or
// more.
struct Anything {
  template <class T>
  operator T() const;  // NOLINT(google-explicit-constructor): that it converts is its purpose
};

template <class T, class Indices, class = void>
struct HasFields : std::false_type {};
template <class T, std::size_t... kIndex>
struct HasFields<T, std::index_sequence<kIndex...>,
                 std::void_t<decltype(T{(static_cast<void>(kIndex), Anything{})...})>>
    : std::true_type {};

template <class T, std::size_t kCount = 64>
constexpr std::size_t NumFields() {
  if constexpr (HasFields<T, std::make_index_sequence<kCount>>::value) {
    return kCount;
  } else {
    return NumFields<T, kCount - 1>();
  }
}

// Keys and sections right below a section.
std::size_t NumNamesBelow(const std::string& section) {
  std::set<std::string> names;
  for (const ConfigEntry& entry : ListConfig(Config())) {
    if (entry.key.compare(0, section.size(), section) != 0) continue;
    const std::string rest = entry.key.substr(section.size());
    names.insert(rest.substr(0, rest.find('.')));
  }
  return names.size();
}

#define EXPECT_CONTAINS(text, part) \
  EXPECT_NE((text).find(part), std::string::npos) << "'" << (text) << "' lacks '" << (part) << "'"

TEST(ConfigKeys, ReachEveryFieldOfTheStages) {
  EXPECT_EQ(NumNamesBelow("input."), NumFields<InputConfig>());
  EXPECT_EQ(NumNamesBelow("robust."), NumFields<RobustConfig>());
  EXPECT_EQ(NumNamesBelow("robust.background."), NumFields<BackgroundConfig>());
  EXPECT_EQ(NumNamesBelow("robust.background.place."), NumFields<RangeRadius>());
  EXPECT_EQ(NumNamesBelow("robust.support."), NumFields<SupportConfig>());
  EXPECT_EQ(NumNamesBelow("robust.plots."), NumFields<PlotConfig>());
  EXPECT_EQ(NumNamesBelow("robust.tracker."), NumFields<TrackerConfig>());
  EXPECT_EQ(NumNamesBelow("robust.collect."), NumFields<CollectConfig>());
  EXPECT_EQ(NumNamesBelow("trajectory."), NumFields<TrajectoryConfig>());
  EXPECT_EQ(NumNamesBelow("live."), NumFields<LiveConfig>());
  EXPECT_EQ(NumNamesBelow("paper."), NumFields<PaperConfig>());
  EXPECT_EQ(NumNamesBelow("paper.global_clusters."), NumFields<ClusteringConfig>());
  EXPECT_EQ(NumNamesBelow("paper.local_clusters."), NumFields<ClusteringConfig>());
}

// A number that nobody can choose better than we did is a constant with its reason, not a key. What
// asks for more keys than this takes others out.
TEST(ConfigKeys, AreNoMoreThanAUserCanChoose) { EXPECT_LE(ListConfig(Config()).size(), 80U); }

TEST(DefaultYaml, HoldsEveryKeyAndNoOther) {
  std::set<std::string> documented;
  CollectKeys(YAML::LoadFile(kDefaultYaml), "", documented);
  std::set<std::string> known;
  for (const ConfigEntry& entry : ListConfig(Config())) known.insert(entry.key);
  EXPECT_EQ(documented, known);
}

TEST(DefaultYaml, HoldsTheDefaultsOfTheStructs) {
  const std::vector<std::string> documented = Listed(LoadConfig(kDefaultYaml, {}));
  const std::vector<std::string> defaults = Listed(Config());
  ASSERT_EQ(documented.size(), defaults.size());
  for (std::size_t i = 0; i < defaults.size(); ++i) EXPECT_EQ(documented[i], defaults[i]);
}

TEST(DefaultYaml, ShowsASensorThatIsTheDefaultSensor) {
  const Config config = FromText(
      "sensors:\n  avia:\n    translation_m: [0.0, 0.0, 0.0]\n"
      "    rotation: [0.0, 0.0, 0.0, 1.0]\n    time_offset_s: 0.0\n    frame_rate_hz: 0.0\n");
  const SensorConfig shown = config.sensors.at("avia");
  const SensorConfig sensor;
  EXPECT_EQ(shown.translation_m, sensor.translation_m);
  EXPECT_EQ(shown.rotation_xyzw, sensor.rotation_xyzw);
  EXPECT_EQ(shown.time_offset_s, sensor.time_offset_s);
}

TEST(LoadConfig, WithoutFileAndAssignmentsGivesTheDefaults) {
  EXPECT_EQ(Listed(LoadConfig("", {})), Listed(Config()));
}

TEST(LoadConfig, AFileOfCommentsOrEmptySectionsChangesNothing) {
  for (const char* text : {"", "# nothing\n", "input:\n", "sensors:\ninput: {}\n", "---\n"}) {
    EXPECT_EQ(Listed(FromText(text)), Listed(Config())) << text;
  }
}

TEST(LoadConfig, SetsValuesOfEveryKind) {
  const Config config = FromText(
      "method: paper\ninput: {skip_bad_frames: true, min_range_m: 1e-1, stamp: end}\n"
      "paper:\n  window_frames: 7\n  global_clusters:\n    method: euclidean\n"
      "sensors:\n  a:\n    translation_m: [1, -2.5, 3e0]\n    rotation: [0, 0, 0.6, 0.8]\n");
  EXPECT_EQ(config.method, Method::kPaper);
  EXPECT_TRUE(config.input.skip_bad_frames);
  EXPECT_EQ(config.input.min_range_m, 0.1);
  EXPECT_EQ(config.input.stamp, StampMeaning::kEnd);
  EXPECT_EQ(config.paper.window_frames, 7);
  EXPECT_EQ(config.paper.global_clusters.method, ClusterMethod::kEuclidean);
  EXPECT_EQ(config.sensors.at("a").translation_m, Eigen::Vector3d(1, -2.5, 3));
  EXPECT_NEAR(config.sensors.at("a").rotation_xyzw.z(), 0.6, 1e-12);
}

TEST(LoadConfig, EveryKeyCanBeSetToItsOwnDefault) {
  for (const ConfigEntry& entry : ListConfig(Config())) {
    const Config config = LoadConfig("", {entry.key + "=" + entry.value.dump()});
    EXPECT_EQ(Listed(config), Listed(Config())) << entry.key;
  }
}

TEST(LoadConfig, AssignmentsGoBeforeTheFileAndTheLastOneWins) {
  const TemporaryFolder folder;
  const std::string path = folder.Write("c.yaml", "input:\n  max_range_m: 10\n");
  EXPECT_EQ(LoadConfig(path, {}).input.max_range_m, 10);
  EXPECT_EQ(LoadConfig(path, {"input.max_range_m=20", "input.max_range_m=30"}).input.max_range_m,
            30);
}

TEST(LoadConfig, AnAssignmentSetsAListOfASensor) {
  const Config config =
      LoadConfig("", {"sensors.mid-360_b.translation_m=[1, 2, 3]", "sensors.c.time_offset_s=-0.5"});
  EXPECT_EQ(config.sensors.at("mid-360_b").translation_m, Eigen::Vector3d(1, 2, 3));
  EXPECT_EQ(config.sensors.at("c").time_offset_s, -0.5);
}

TEST(LoadConfig, AListMayHaveAnyLengthButNone) {
  EXPECT_EQ(FromText("robust: {tracker: {sigma_a_mps2: [2]}}\n").robust.tracker.sigma_a_mps2,
            std::vector<double>{2.0});
  EXPECT_EQ(LoadConfig("", {"robust.tracker.birth_speeds_mps=[1, 2e0, 0.5, 4]"})
                .robust.tracker.birth_speeds_mps,
            (std::vector<double>{1.0, 2.0, 0.5, 4.0}));
}

TEST(LoadConfig, ADelayAndAWindowMayBeEndless) {
  const Config config = FromText("live: {delay_s: .inf, window_s: .inf}\n");
  EXPECT_TRUE(std::isinf(config.live.delay_s) && config.live.delay_s > 0);
  EXPECT_TRUE(std::isinf(config.live.window_s) && config.live.window_s > 0);
  EXPECT_EQ(LoadConfig("", {"live.delay_s=.inf"}).live.delay_s, config.live.delay_s);
}

TEST(LoadConfig, ARotationIsNormalised) {
  const Config config = FromText("sensors: {a: {rotation: [0, 0, 0, 1.0005]}}\n");
  EXPECT_EQ(config.sensors.at("a").rotation_xyzw, Eigen::Vector4d(0, 0, 0, 1));
}

TEST(LoadConfig, ANormalisedRotationIsReadAsItIsListed) {
  for (int i = 1; i <= 200; ++i) {
    const Config config = LoadConfig(
        "", {"sensors.a.rotation=" + std::string("[0.1, 0.2, ") + std::to_string(0.001 * i) + ", " +
             std::to_string(std::sqrt(0.95 - 1e-6 * i * i)) + "]"});
    std::string rotation;
    for (const ConfigEntry& entry : ListConfig(config)) {
      if (entry.key == "sensors.a.rotation") rotation = entry.value.dump();
    }
    const Config again = LoadConfig("", {"sensors.a.rotation=" + rotation});
    ASSERT_EQ(again.sensors.at("a").rotation_xyzw, config.sensors.at("a").rotation_xyzw) << i;
  }
}

TEST(LoadConfig, AnEmptySensorIsTheIdentity) {
  EXPECT_EQ(FromText("sensors:\n  a:\n  b: {}\n").sensors.size(), 2U);
}

TEST(LoadConfig, ReadsNumbersTheSameInEveryLocale) {
  for (const char* name : {"de_DE.UTF-8", "fr_FR.UTF-8"}) std::setlocale(LC_ALL, name);
  EXPECT_EQ(FromText("input: {min_range_m: 0.25}\n").input.min_range_m, 0.25);
  std::setlocale(LC_ALL, "C");
}

TEST(ConfigErrors, NameFileLineKeyValueAndConstraint) {
  EXPECT_EQ(ReasonOfFile("input:\n  max_range_m: far\n"),
            ":2: input.max_range_m: 'far', expected a number above 0 to 100000");
  EXPECT_EQ(ReasonOfFile("\n\nmethod: magic\n"),
            ":3: method: 'magic', expected one of robust, paper");
  EXPECT_EQ(ReasonOfFile("paper:\n  window_frames: 2.0\n"),
            ":2: paper.window_frames: '2.0', expected an integer from 1 to 1000000");
  EXPECT_EQ(ReasonOfFile("robust:\n  window_s: .inf\n"),
            ":2: robust.window_s: '.inf', expected a number from 5 to 90");
  EXPECT_EQ(ReasonOfFile("input:\n\n  skip_bad_frames: yes\n"),
            ":3: input.skip_bad_frames: 'yes', expected true or false");
  EXPECT_EQ(ReasonOfFile("input:\n  max_range_m:\n"),
            ":2: input.max_range_m: nothing, expected a number above 0 to 100000");
}

TEST(ConfigErrors, RefuseEveryWrongNumber) {
  for (const char* value : {"-3", "0", ".nan", ".inf", "1e400", "0x10", "1,5", "1 m", "''", "[1]",
                            "{a: 1}", "~", "true", "100001"}) {
    EXPECT_CONTAINS(ReasonOfFile(std::string("input:\n  max_range_m: ") + value + "\n"),
                    ":2: input.max_range_m: ");
  }
}

TEST(ConfigErrors, RefuseEveryWrongDelay) {
  for (const char* value : {"0", "-1", "601", "-.inf", "inf", ".nan", "1 s", "~", "[.inf]"}) {
    EXPECT_CONTAINS(ReasonOfFile(std::string("live:\n  delay_s: ") + value + "\n"),
                    ", expected a number above 0 to 600, or .inf");
  }
  EXPECT_CONTAINS(ReasonOfSet("live.reorder_s=.inf"), "expected a number from 0 to 60");
  EXPECT_EQ(ReasonOfSet("live.reorder_s=1"),
            "--set live.reorder_s=1: live.delay_s: '1', expected more than live.reorder_s (1)");
}

TEST(ConfigErrors, RefuseEveryWrongList) {
  for (const char* value : {"[]", "3", "[1, 2, x]", "[0]", "[1, -1]", "[1, 1001]", "[.nan]",
                            "[[1]]", "{a: 1}", "~", "''"}) {
    EXPECT_CONTAINS(
        ReasonOfFile(std::string("robust:\n  tracker:\n    sigma_a_mps2: ") + value + "\n"),
        ", expected a list of one or more numbers, each from 0.01 to 1000");
  }
}

TEST(ConfigErrors, RefuseEveryWrongPose) {
  for (const char* line :
       {"translation_m: [1, 2]", "translation_m: [1, 2, 3, 4]", "translation_m: 1",
        "translation_m: [1, 2, .nan]", "translation_m: [1, 2, 1e7]", "rotation: [0, 0, 0, 0]",
        "rotation: [0, 0, 0, 1.002]", "rotation: [0, 0, 1]", "rotation: [1, 1, 1, 1]",
        "time_offset_s: 1e10"}) {
    EXPECT_CONTAINS(ReasonOfFile(std::string("sensors:\n  a:\n    ") + line + "\n"),
                    ":3: sensors.a.");
  }
  EXPECT_CONTAINS(ReasonOfFile("sensors:\n  a b:\n    time_offset_s: 1\n"), ":2: sensors: 'a b'");
}

TEST(ConfigErrors, NameTheNearestKeyForAnUnknownOne) {
  EXPECT_EQ(ReasonOfFile("input:\n  max_rnge_m: 3\n"),
            ":2: input.max_rnge_m: unknown key; did you mean input.max_range_m?");
  EXPECT_CONTAINS(ReasonOfFile("sensors:\n  a:\n    translation: [0, 0, 0]\n"),
                  "did you mean sensors.a.translation_m?");
  EXPECT_CONTAINS(ReasonOfFile("max_range_m: 3\n"), "did you mean input.max_range_m?");
  EXPECT_CONTAINS(ReasonOfSet("colour=red"), "--set colour=red: colour: unknown key");
  EXPECT_CONTAINS(ReasonOfSet("input=3"), "unknown key");
  EXPECT_CONTAINS(ReasonOfSet("sensors.a=3"), "unknown key");
  EXPECT_CONTAINS(ReasonOfSet("sensors.time_offset_s=3"), "unknown key");
}

TEST(ConfigErrors, TellWhatBecameOfAFormerKey) {
  EXPECT_EQ(ReasonOfFile("robust:\n  min_echo_m2_per_s: 150\n"),
            ":2: robust.min_echo_m2_per_s: unknown key; it is robust.min_cross_section_m2 now");
  EXPECT_EQ(ReasonOfFile("robust:\n  ground:\n    cell_m: 4\n"),
            ":2: robust.ground: unknown key; the method has no such setting any more");
  EXPECT_EQ(ReasonOfSet("robust.plots.spot.slope=0"),
            "--set robust.plots.spot.slope=0: robust.plots.spot.slope: unknown key; the "
            "method has no such setting any more");
  EXPECT_CONTAINS(ReasonOfSet("robust.plots.spots=0"), "unknown key; configs/default.yaml");
  std::set<std::string> keys;
  for (const ConfigEntry& entry : ListConfig(Config())) keys.insert(entry.key);
  for (const FormerKey& former : kFormerKeys) {
    EXPECT_TRUE(former.now.empty() || keys.count(std::string(former.now)) > 0) << former.now;
    EXPECT_CONTAINS(ReasonOfSet(std::string(former.key) + "=1"),
                    former.now.empty() ? "unknown key; the method has no such setting any more"
                                       : "unknown key; it is " + std::string(former.now) + " now");
  }
}

TEST(ConfigErrors, RefuseARepeatedOrDottedKey) {
  EXPECT_CONTAINS(ReasonOfFile("input:\n  max_range_m: 5\n  max_range_m: 5\n"),
                  ":3: input.max_range_m: repeated");
  EXPECT_CONTAINS(ReasonOfFile("input: {}\nmethod: paper\ninput: {}\n"), ":3: input: repeated");
  EXPECT_CONTAINS(ReasonOfFile("input.max_range_m: 5\n"), ":1: 'input.max_range_m' is not a key");
}

TEST(ConfigErrors, RefuseWhatIsNoMapOrNoYaml) {
  EXPECT_CONTAINS(ReasonOfFile("- a\n- b\n"), ":1: ");
  EXPECT_CONTAINS(ReasonOfFile("just text\n"), ":1: 'just text', expected");
  EXPECT_CONTAINS(ReasonOfFile("input: 3\n"), ":1: input: '3', expected a section");
  EXPECT_CONTAINS(ReasonOfFile("input:\n  max_range_m: [5\n"), ", expected YAML");
  EXPECT_CONTAINS(ReasonOfFile("method: paper\n---\nmethod: robust\n"),
                  ":2: what stands here is no part of the YAML document before it");
  EXPECT_CONTAINS(ReasonOfFile("? [a, b]\n: c\n"), "is not a key");
  EXPECT_CONTAINS(ReasonOfFile(std::string(2'000'000, '#')), "262144 bytes");
  EXPECT_CONTAINS(ReasonOfFile(std::string(100'000, '[')), ":1: more than 500 levels");
}

// Where the parser cannot pass a character, it gives an empty document before it without end.
TEST(ConfigErrors, RefuseACharacterThatTheParserNeverPasses) {
  for (const char* text :
       {",", ",\n", "\n,a: 1", "method: paper\n---\n,", "]", "}", "%YAML 1.2\n,"}) {
    EXPECT_CONTAINS(ReasonOfFile(text), ", expected ");
    EXPECT_CONTAINS(ReasonOfSet(std::string("input.max_range_m=") + text), ", expected ");
  }
  EXPECT_CONTAINS(ReasonOfFile("input: {}\n,\n"), ":2: ");
  EXPECT_CONTAINS(ReasonOfSet("input.max_range_m=5\n---\n6"), "expected one document");
}

// One token after the other from those that YAML gives a meaning.
std::string RandomYaml(Random& random) {
  static const std::vector<std::string> tokens = {",",
                                                  "[",
                                                  "]",
                                                  "{",
                                                  "}",
                                                  ":",
                                                  ": ",
                                                  "- ",
                                                  "\n",
                                                  "\n ",
                                                  "\n  ",
                                                  "? ",
                                                  "&a ",
                                                  "*a",
                                                  "|\n",
                                                  ">\n",
                                                  "'",
                                                  "\"",
                                                  "#",
                                                  "%",
                                                  "%YAML 1.2\n",
                                                  "---\n",
                                                  "...\n",
                                                  "!",
                                                  "!!str ",
                                                  "!<",
                                                  "a",
                                                  "~",
                                                  "\t",
                                                  "@",
                                                  "`",
                                                  "\r",
                                                  "\xEF\xBB\xBF",
                                                  "\x80",
                                                  "\x01",
                                                  "1.5",
                                                  "<<: ",
                                                  "input: ",
                                                  "sensors: ",
                                                  "method: ",
                                                  "max_range_m: ",
                                                  "rotation: "};
  std::string text;
  for (std::uint32_t left = random.Index(60) + 1; left > 0; --left) {
    text += tokens[random.Index(tokens.size())];
  }
  return text;
}

TEST(ConfigErrors, EveryTextIsReadOrRefusedInOneLine) {
  Random random(1);
  for (int i = 0; i < 800; ++i) {
    const std::string text = RandomYaml(random);
    SCOPED_TRACE(text);
    try {
      LoadConfig("", {"robust.tracker.sigma_a_mps2=" + text});
    } catch (const ConfigError& error) {
      EXPECT_EQ(std::string(error.what()).find('\n'), std::string::npos);
    }
    const TemporaryFolder folder;
    const std::string path = folder.Write("c.yaml", text);
    try {
      LoadConfig(path, {});
    } catch (const ConfigError& error) {
      EXPECT_EQ(std::string(error.what()).find('\n'), std::string::npos);
      EXPECT_EQ(std::string(error.what()).find(path), 0U);
    }
  }
}

TEST(ConfigErrors, ShortenWhatTheyQuote) {
  const std::string endless(200'000, 'x');
  for (const std::string& text :
       {endless, endless + ": 1", "input: " + endless, "input: {max_range_m: " + endless + "}",
        "input: {" + endless + ": 1}", "sensors: {" + endless + ": {time_offset_s: x}}",
        "sensors: {" + endless + ": {}, " + endless + ": {}}",
        "sensors: {\"a " + endless + "\": {}}", "input: {max_range_m: [" + endless + "]}",
        "input: !<" + endless + " {a: *" + endless + "}"}) {
    EXPECT_LT(ReasonOfFile(text).size(), 400U);
  }
  EXPECT_LT(ReasonOfSet("input.max_range_m=" + endless).size(), 400U);
  EXPECT_LT(ReasonOfSet(endless + "=1").size(), 400U);
}

TEST(ConfigErrors, AliasesThatGrowWithEachLevelCostNothing) {
  std::string text = "a0: &a0 [x, x, x, x, x, x, x, x, x, x]\n";
  for (int i = 1; i < 60; ++i) {
    const std::string before = "*a" + std::to_string(i - 1);
    text += "a" + std::to_string(i) + ": &a" + std::to_string(i) + " [" + before;
    for (int k = 1; k < 10; ++k) text += ", " + before;
    text += "]\n";
  }
  EXPECT_CONTAINS(ReasonOfFile(text), ":1: a0: unknown key");
  EXPECT_CONTAINS(ReasonOfFile("input:\n  max_range_m: &a [*a, *a]\n"), ":2: ");
  const std::string lists = text.substr(0, text.find("a1: "));
  EXPECT_CONTAINS(ReasonOfFile("method:\n- " + lists.substr(4) + "- [*a0, *a0, *a0]\n"), ":1: ");
}

TEST(ConfigErrors, RefuseAFileThatCannotBeRead) {
  const TemporaryFolder folder;
  for (const std::string& path : {folder / "none.yaml", folder.path()}) {
    const std::string reason = ReasonOf<ConfigError>([&] { LoadConfig(path, {}); });
    EXPECT_CONTAINS(reason, path + ": cannot be read (");
  }
}

TEST(ConfigErrors, NameTheAssignment) {
  EXPECT_EQ(ReasonOfSet("input.max_range_m=far"),
            "--set input.max_range_m=far: input.max_range_m: 'far', expected a number above 0 to "
            "100000");
  EXPECT_CONTAINS(ReasonOfSet("input.max_range_m="), "input.max_range_m: nothing, expected");
  EXPECT_CONTAINS(ReasonOfSet("input.max_range_m=[1"), "--set input.max_range_m=[1: ");
}

TEST(Config, RulesAreDisabledByName) {
  EXPECT_TRUE(Config().robust.Uses(Rule::kCloud));
  const Config config = LoadConfig("", {"robust.disabled_rules=[cloud, spots]"});
  EXPECT_FALSE(config.robust.Uses(Rule::kCloud));
  EXPECT_FALSE(config.robust.Uses(Rule::kSpots));
  EXPECT_TRUE(config.robust.Uses(Rule::kInsect));
  EXPECT_TRUE(LoadConfig("", {"robust.disabled_rules=[]"}).robust.disabled_rules.empty());
}

TEST(ConfigErrors, ARuleThatIsNoneOrIsNamedTwiceIsRefused) {
  for (const char* rules : {"[clouds]", "cloud", "[cloud, cloud]", "[[cloud]]", "[1]"}) {
    EXPECT_CONTAINS(ReasonOfSet("robust.disabled_rules=" + std::string(rules)),
                    "expected a list of different ones, of transient, dwell, ");
  }
}

TEST(ConfigErrors, TellThatAFormerRuleIsGone) {
  for (const std::string_view rule : kFormerRules) {
    EXPECT_CONTAINS(ReasonOfSet("robust.disabled_rules=[cloud, " + std::string(rule) + "]"),
                    "; the method has no rule " + std::string(rule) + " any more");
  }
  EXPECT_EQ(ReasonOfSet("robust.disabled_rules=[clouds]").find("any more"), std::string::npos);
}

TEST(ConfigErrors, AnAssignmentWithoutKeyOrValueIsWrongUsage) {
  for (const char* assignment : {"input.max_range_m", "", "=3"}) {
    const std::string reason = ReasonOf<UsageError>([&] { LoadConfig("", {assignment}); });
    EXPECT_CONTAINS(reason, "expected section.key=value");
  }
}

TEST(ConfigErrors, ConstraintsBetweenKeysNameTheLineThatBrokeThem) {
  EXPECT_EQ(ReasonOfFile("input:\n  max_range_m: 3\n  min_range_m: 4\n"),
            ":2: input.max_range_m: '3', expected more than input.min_range_m (4)");
  EXPECT_CONTAINS(ReasonOfSet("input.min_range_m=3000"), "--set input.min_range_m=3000: ");
}

// Makes the value of one key, by its place in the table, one that no constraint allows.
struct Spoiler {
  std::size_t target;
  std::size_t visited = 0;
  std::string spoilt = {};  // the key, if it has such a value

  template <class Field, class Constraint>
  void operator()(const std::string& key, Field& field, const Constraint&) {
    if (visited++ != target || std::is_same_v<Field, bool>) return;
    spoilt = key;
    if constexpr (std::is_enum_v<Field>) {
      field = static_cast<Field>(99);
    } else if constexpr (std::is_same_v<Field, double>) {
      field = std::nan("");
    } else if constexpr (std::is_same_v<Field, int>) {
      field = -1;
    } else if constexpr (std::is_same_v<Field, std::vector<double>>) {
      field = {1.0, -1e9};
    } else if constexpr (std::is_same_v<Field, std::vector<Rule>>) {
      field = {static_cast<Rule>(99)};
    } else if constexpr (std::is_same_v<Field, std::vector<MotionRule>>) {
      field = {static_cast<MotionRule>(99)};
    } else if constexpr (!std::is_same_v<Field, bool>) {
      field.setConstant(std::nan(""));
    }
  }
};

TEST(ConfigErrors, AValueSetByHandIsHeldToTheConstraintOfItsKey) {
  EXPECT_NO_THROW(CheckConfig(Config()));
  Config with_sensor;
  with_sensor.sensors["a"] = {};
  EXPECT_NO_THROW(CheckConfig(with_sensor));
  const auto visit_all = [](Config& config, Spoiler& spoiler) {
    VisitKeys(spoiler, config);
    VisitSensorKeys(spoiler, "sensors.a.", config.sensors["a"]);
  };
  std::size_t num_keys = 1;
  std::size_t num_spoilt = 0;
  for (std::size_t i = 0; i < num_keys; ++i) {
    Config config = with_sensor;
    Spoiler spoiler{i};
    visit_all(config, spoiler);
    num_keys = spoiler.visited;
    if (spoiler.spoilt.empty()) continue;
    ++num_spoilt;
    const std::string reason = ReasonOf<ConfigError>([&] { CheckConfig(config); });
    EXPECT_EQ(reason.find(spoiler.spoilt + ": "), 0U) << reason;
    EXPECT_CONTAINS(reason, ", expected ");
  }
  EXPECT_GT(num_spoilt, 70U);
  Config config;
  config.robust.tracker.sigma_a_mps2 = {1.0, -3.0};
  EXPECT_EQ(ReasonOf<ConfigError>([&] { CheckConfig(config); }),
            "robust.tracker.sigma_a_mps2: [1, -3], expected a list of one or more numbers, each "
            "from 0.01 to 1000");
}

TEST(ConfigErrors, ConstraintsBetweenKeysAndNamesOfSensorsHoldForValuesSetByHand) {
  Config config;
  config.input.min_range_m = 3000.0;
  EXPECT_EQ(ReasonOf<ConfigError>([&] { CheckConfig(config); }),
            "input.max_range_m: '2000', expected more than input.min_range_m (3000)");
  config = {};
  config.sensors["a b"] = {};
  EXPECT_EQ(ReasonOf<ConfigError>([&] { CheckConfig(config); }),
            "sensors: 'a b', expected a name of up to 120 letters, digits, '_' and '-'");
}

TEST(SensorNames, MayBeMissingOnEitherSideButNotOnBoth) {
  Config config;
  EXPECT_NO_THROW(CheckSensorNames(config, {{"avia", "a"}, {"", "b"}}));
  config.sensors["avia"] = {};
  EXPECT_NO_THROW(CheckSensorNames(config, {{"avia", "a"}, {"mid360", "b"}}));
  EXPECT_NO_THROW(CheckSensorNames(config, {{"", "a"}}));
  const std::string reason = ReasonOf<ConfigError>([&] {
    CheckSensorNames(config, {{"avai", "a"}});
  });
  EXPECT_CONTAINS(reason, "--frames avai=a: the config has no sensors.avai");
}

}  // namespace
}  // namespace unlidar
