// The clustering engine `pcl`, apart from the library: who links that needs no PCL.
#pragma once

namespace unlidar {

// From now on Cluster() has the engine `pcl`. Call before other threads are started.
void UsePclClustering();

}  // namespace unlidar
