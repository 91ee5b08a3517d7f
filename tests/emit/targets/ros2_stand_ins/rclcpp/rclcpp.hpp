// A small stand-in, for tests alone: messages are delivered by calling `publish` of the node.
#pragma once
#include <cstdint>
#include <cstdio>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include <rclcpp/node_interfaces/node_parameters_interface.hpp>

#define RCLCPP_ERROR(logger, ...) std::snprintf(logger.said, sizeof(logger.said), __VA_ARGS__)

namespace rclcpp {
struct Time {};
struct Duration {
    double length;
    double seconds() const { return length; }
};
struct SystemDefaultsQoS {};
struct Logger {
    char (&said)[200];
};
template <class Message> struct Subscription {
    using SharedPtr = std::shared_ptr<Subscription>;
    std::function<void(const Message &)> callback;
};
} // namespace rclcpp

namespace rclcpp_lifecycle {
struct State {};
struct LifecycleNode {
    std::map<std::string, rclcpp::Parameter> known;
    std::map<std::string, std::shared_ptr<void>> topics;
    char said[200] = "";
    rclcpp::Parameter get_parameter(const std::string &name) const { return known.at(name); }
    rclcpp::Logger get_logger() { return {said}; }
    template <class Message, class Callback>
    std::shared_ptr<rclcpp::Subscription<Message>> create_subscription(const std::string &topic, rclcpp::SystemDefaultsQoS, Callback callback)
    {
        auto made = std::make_shared<rclcpp::Subscription<Message>>();
        made->callback = callback;
        topics[topic] = made;
        return made;
    }
    template <class Message> void publish(const std::string &topic, const Message &message)
    {
        std::static_pointer_cast<rclcpp::Subscription<Message>>(topics.at(topic))->callback(message);
    }
};
} // namespace rclcpp_lifecycle
