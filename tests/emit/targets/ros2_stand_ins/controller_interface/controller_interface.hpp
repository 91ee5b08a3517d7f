// A small stand-in, for tests alone: interfaces point to numbers of the test, which calls the base class.
#pragma once
#include <memory>
#include <optional>
#include <string>
#include <type_traits>
#include <vector>

#include <rclcpp/rclcpp.hpp>

namespace hardware_interface {
struct LoanedStateInterface {
    double *value;
    template <class Type = double> [[nodiscard]] std::optional<Type> get_optional(unsigned = 10) const { return *value; }
};
struct LoanedCommandInterface {
    double *value;
    template <class Type> [[nodiscard]] bool set_value(const Type &to, unsigned = 10)
    {
        *value = to;
        return true;
    }
};
} // namespace hardware_interface

namespace controller_interface {
enum class return_type : unsigned char { OK, ERROR };
enum class CallbackReturn { SUCCESS, FAILURE, ERROR };
enum class interface_configuration_type { ALL, INDIVIDUAL, NONE };
struct InterfaceConfiguration {
    interface_configuration_type type;
    std::vector<std::string> names = {};
};
class ControllerInterface {
public:
    virtual ~ControllerInterface() = default;
    virtual InterfaceConfiguration command_interface_configuration() const = 0;
    virtual InterfaceConfiguration state_interface_configuration() const = 0;
    virtual CallbackReturn on_init() = 0;
    virtual CallbackReturn on_configure(const rclcpp_lifecycle::State &) { return CallbackReturn::SUCCESS; }
    virtual CallbackReturn on_activate(const rclcpp_lifecycle::State &) { return CallbackReturn::SUCCESS; }
    virtual CallbackReturn on_deactivate(const rclcpp_lifecycle::State &) { return CallbackReturn::SUCCESS; }
    virtual return_type update(const rclcpp::Time &, const rclcpp::Duration &) = 0;
    std::shared_ptr<rclcpp_lifecycle::LifecycleNode> get_node() const { return node_; }
    std::vector<hardware_interface::LoanedCommandInterface> command_interfaces_;
    std::vector<hardware_interface::LoanedStateInterface> state_interfaces_;

protected:
    template <class Type> Type auto_declare(const std::string &name, const Type &value)
    {
        auto &to = node_->known[name];
        if constexpr (std::is_same_v<Type, double>) {
            to.numbers = {value};
        } else if constexpr (std::is_same_v<Type, std::vector<double>>) {
            to.numbers = value;
        } else if constexpr (std::is_same_v<Type, std::string>) {
            to.text = value;
        } else if constexpr (std::is_same_v<Type, std::vector<std::string>>) {
            to.texts = value;
        } else {
            to.integer = value;
        }
        return value;
    }

private:
    std::shared_ptr<rclcpp_lifecycle::LifecycleNode> node_ = std::make_shared<rclcpp_lifecycle::LifecycleNode>();
};
} // namespace controller_interface
