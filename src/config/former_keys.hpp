// Keys of earlier versions, so that a file or --set which still has one learns what became of it.
#pragma once

#include <algorithm>
#include <array>
#include <string_view>

namespace unlidar {

struct FormerKey {
  std::string_view key;  // or a section, with all keys in it
  std::string_view now;  // the key that replaces it; empty: none does
};

inline constexpr std::array<FormerKey, 40> kFormerKeys{{
    {"robust.background.max_break_s", "robust.background.max_dwell_gap_s"},
    {"robust.collect.body_sigma_m", "robust.collect.extent_sigma_m"},
    {"robust.collect.facing_side", "robust.collect.centroid_offset"},
    {"robust.min_echo_m2_per_s", "robust.min_return_rate_m2_per_s"},
    {"robust.tracker.echo_m2_per_s", "robust.tracker.return_rate_m2_per_s"},
    {"robust.tracker.even_birth_share", "robust.tracker.uniform_birth_share"},
    {"robust.tracker.manoeuvre_log", "robust.tracker.manoeuvre_log_probability"},
    {"trajectory.silence_probability", "trajectory.min_missed_run_probability"},
    {"robust.background.bin_s", ""},
    {"robust.background.occluder_cell_deg", ""},
    {"robust.background.occluder_margin_m", ""},
    {"robust.collect.rounds", ""},
    {"robust.ground", ""},
    {"robust.off_ground_share", ""},
    {"robust.plots.body_contact_m", ""},
    {"robust.plots.body_contact_returns", ""},
    {"robust.plots.body_spread_returns", ""},
    {"robust.plots.clutter_middle", ""},
    {"robust.plots.clutter_narrow", ""},
    {"robust.plots.spot", ""},
    {"robust.rounds", ""},
    {"robust.support.body_m", ""},
    {"robust.support.far_m", ""},
    {"robust.support.far_reach", ""},
    {"robust.support.max_hidden_share", ""},
    {"robust.support.voxel_m", ""},
    {"robust.tracker.birth_cost", ""},
    {"robust.tracker.echo_shape", ""},
    {"robust.tracker.give_up_log", ""},
    {"robust.tracker.max_hypotheses_per_plot", ""},
    {"robust.tracker.max_paths", ""},
    {"robust.tracker.min_exchange_log", ""},
    {"robust.tracker.min_fragment_log", ""},
    {"robust.tracker.min_fragment_plots", ""},
    {"robust.tracker.rebirth_log", ""},
    {"trajectory.max_knot_spacing_s", ""},
    {"trajectory.max_noise_scale", ""},
    {"trajectory.min_knot_spacing_s", ""},
    {"trajectory.min_noise_scale", ""},
    {"trajectory.outlier_distance", ""},
}};

// Rules that `robust.disabled_rules` could name in earlier versions.
inline constexpr std::array<std::string_view, 2> kFormerRules{"clutter_returns",
                                                              "permutation_null"};

// Returns the entry of a key or of its section; null for a key that never was one.
inline const FormerKey* FindFormerKey(std::string_view key) {
  const auto* const found =
      std::find_if(kFormerKeys.begin(), kFormerKeys.end(), [&](const FormerKey& former) {
        return key.substr(0, former.key.size()) == former.key &&
               (key.size() == former.key.size() || key[former.key.size()] == '.');
      });
  return found == kFormerKeys.end() ? nullptr : found;
}

}  // namespace unlidar
