// A small stand-in, for tests alone: the virtual functions that a solver overrides, and the messages in them.
#pragma once
#include <functional>
#include <string>
#include <vector>
#include <rclcpp/node_interfaces/node_parameters_interface.hpp>
namespace geometry_msgs::msg {
struct Pose {
    struct { double x = 0, y = 0, z = 0; } position;
    struct { double x = 0, y = 0, z = 0, w = 1; } orientation;
};
} // namespace geometry_msgs::msg
namespace moveit_msgs::msg {
struct MoveItErrorCodes {
    int val = 0;
    static constexpr int SUCCESS = 1, FAILURE = 99999, NO_IK_SOLUTION = -31;
};
} // namespace moveit_msgs::msg
namespace moveit::core {
struct RobotModel {};
} // namespace moveit::core
namespace kinematics {
namespace KinematicErrors {
enum KinematicError { OK = 1, MULTIPLE_TIPS_NOT_SUPPORTED = 4, EMPTY_TIP_POSES = 5, NO_SOLUTION = 8 };
}
struct KinematicsQueryOptions {};
struct KinematicsResult {
    KinematicErrors::KinematicError kinematic_error;
    double solution_percentage;
};
class KinematicsBase {
protected:
    using Pose = geometry_msgs::msg::Pose;
    using Codes = moveit_msgs::msg::MoveItErrorCodes;
    using Options = KinematicsQueryOptions;
    using Numbers = std::vector<double>;
    using Names = std::vector<std::string>;
    rclcpp::Node::SharedPtr node_;
    Names tip_frames_;
    void storeValues(const moveit::core::RobotModel &, const std::string &, const std::string &, const Names &tips, double)
    {
        tip_frames_ = tips;
    }
public:
    using IKCallbackFn = std::function<void(const Pose &, const Numbers &, Codes &)>;
    virtual ~KinematicsBase() = default;
    virtual bool initialize(const rclcpp::Node::SharedPtr &, const moveit::core::RobotModel &, const std::string &,
                            const std::string &, const Names &, double) = 0;
    virtual bool getPositionIK(const Pose &, const Numbers &, Numbers &, Codes &, const Options & = {}) const = 0;
    virtual bool getPositionIK(const std::vector<Pose> &, const Numbers &, std::vector<Numbers> &, KinematicsResult &,
                               const Options &) const = 0;
    virtual bool searchPositionIK(const Pose &, const Numbers &, double, Numbers &, Codes &, const Options & = {}) const = 0;
    virtual bool searchPositionIK(const Pose &, const Numbers &, double, const Numbers &, Numbers &, Codes &,
                                  const Options & = {}) const = 0;
    virtual bool searchPositionIK(const Pose &, const Numbers &, double, Numbers &, const IKCallbackFn &, Codes &,
                                  const Options & = {}) const = 0;
    virtual bool searchPositionIK(const Pose &, const Numbers &, double, const Numbers &, Numbers &, const IKCallbackFn &,
                                  Codes &, const Options & = {}) const = 0;
    virtual bool getPositionFK(const Names &, const Numbers &, std::vector<Pose> &) const = 0;
    virtual const Names &getJointNames() const = 0;
    virtual const Names &getLinkNames() const = 0;
};
} // namespace kinematics
