// A small stand-in, for tests alone.
#pragma once
#include <string>
namespace std_msgs {
namespace msg {
struct String {
    std::string data;
};
} // namespace msg
} // namespace std_msgs
