// A small stand-in, for tests alone: parameters are kept in maps.
#pragma once
#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <vector>
namespace rclcpp {
struct Parameter {
    std::vector<double> numbers;
    std::string text;
    std::vector<std::string> texts = {};
    int64_t integer = 0;
    std::vector<double> as_double_array() const { return numbers; }
    double as_double() const { return numbers.at(0); }
    std::string as_string() const { return text; }
    std::vector<std::string> as_string_array() const { return texts; }
    int64_t as_int() const { return integer; }
};
namespace node_interfaces {
struct NodeParametersInterface {
    using SharedPtr = std::shared_ptr<NodeParametersInterface>;
    using ConstSharedPtr = std::shared_ptr<const NodeParametersInterface>;
    std::map<std::string, Parameter> known;
    bool has_parameter(const std::string &name) const { return known.count(name) != 0; }
    Parameter get_parameter(const std::string &name) const { return known.at(name); }
};
} // namespace node_interfaces
struct Node {
    using SharedPtr = std::shared_ptr<Node>;
};
} // namespace rclcpp
