// What a live source and the engine behind it may hold, and for how long.
#pragma once

namespace unlidar {

struct LiveConfig {
  double delay_s = 1.0;                // of a row behind its instant; infinity: all rows at the end
  double window_s = 60.0;              // of what is remembered frame by frame; infinity: everything
  double reorder_s = 0.2;              // by which a frame may come later than newer ones
  double false_alarms_per_hour = 0.1;  // of an empty sky
  double silent_s = 2.0;               // without a frame: the sensor is silent
  double overload_s = 2.0;  // that a frame waits, by the wall clock, before others are dropped
};

}  // namespace unlidar
