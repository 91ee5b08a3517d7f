// A small stand-in, for tests alone.
#pragma once
#include <vector>
namespace std_msgs {
namespace msg {
struct Float64MultiArray {
    std::vector<double> data;
};
} // namespace msg
} // namespace std_msgs
