// A small stand-in, for tests alone: the virtual functions of the interface, later ones included.
#pragma once
#include <memory>
#include <string>
#include <vector>
#include <eigen3/Eigen/Core>
#include <eigen3/Eigen/Geometry>
#include <eigen3/Eigen/Cholesky>
#include <rclcpp/node_interfaces/node_parameters_interface.hpp>
namespace kinematics_interface {
class KinematicsInterface {
    using Vector = Eigen::VectorXd;
    using Twist = Eigen::Matrix<double, 6, 1>;
    using Pose = Eigen::Matrix<double, 7, 1>;
    using Jacobian = Eigen::Matrix<double, 6, Eigen::Dynamic>;
    using Numbers = std::vector<double>;
public:
    virtual ~KinematicsInterface() = default;
    virtual bool initialize(const std::string &, std::shared_ptr<rclcpp::node_interfaces::NodeParametersInterface>,
                            const std::string &) = 0;
    virtual bool convert_cartesian_deltas_to_joint_deltas(const Vector &, const Twist &, const std::string &, Vector &) = 0;
    virtual bool convert_joint_deltas_to_cartesian_deltas(const Vector &, const Vector &, const std::string &, Twist &) = 0;
    virtual bool calculate_link_transform(const Vector &, const std::string &, Eigen::Isometry3d &) = 0;
    virtual bool calculate_jacobian(const Vector &, const std::string &, Jacobian &) = 0;
    virtual bool calculate_jacobian_inverse(const Vector &, const std::string &, Eigen::Matrix<double, Eigen::Dynamic, 6> &) = 0;
    virtual bool calculate_frame_difference(Pose &, Pose &, double, Twist &) = 0;
    bool convert_cartesian_deltas_to_joint_deltas(Numbers &, const Numbers &, const std::string &, Numbers &);
    bool convert_joint_deltas_to_cartesian_deltas(const Numbers &, const Numbers &, const std::string &, Numbers &);
    bool calculate_link_transform(const Numbers &, const std::string &, Eigen::Isometry3d &);
    bool calculate_jacobian(const Numbers &, const std::string &, Jacobian &);
};
} // namespace kinematics_interface
