/* Pinocchio's recursions over a tree of revolute joints, on a base at rest or a free flyer, behind plain C functions, and
   the inverse dynamics of a planar closed loop made of them. */
#define BOOST_MPL_CFG_NO_PREPROCESSED_HEADERS /* its joint types outnumber the lists that Boost has preprocessed */
#define BOOST_MPL_LIMIT_LIST_SIZE 30
#define BOOST_FUSION_INVOKE_MAX_ARITY 10
#include <memory>
#include <pinocchio/algorithm/aba.hpp>
#include <pinocchio/algorithm/crba.hpp>
#include <pinocchio/algorithm/jacobian.hpp>
#include <pinocchio/algorithm/kinematics.hpp>
#include <pinocchio/algorithm/rnea-second-order-derivatives.hpp>
#include <pinocchio/algorithm/rnea.hpp>
#include <string>
#include <vector>

namespace pin = pinocchio;
using Input = Eigen::Map<const Eigen::VectorXd>;
using Matrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

static pin::Model model;
static std::unique_ptr<pin::Data> data;

static pin::Inertia inertia(const double *body)
{
    return pin::Inertia(body[0], Eigen::Map<const Eigen::Vector3d>(body + 1), Eigen::Map<const Eigen::Matrix3d>(body + 4));
}

extern "C" {

/* parents: n numbers of joints, -1 for the base; places: n placements (16 each) in the joint before; bodies: n times
   mass, centre (3), tensor about the centre (9) in joint axes; armature: n inertias of drives; base: that of a floating
   base, or null. */
void tree_setup(int n, const int *parents, const double *places, const double *bodies, const double *armature, const double *base, const double *gravity)
{
    model = pin::Model();
    model.gravity.linear() = Eigen::Map<const Eigen::Vector3d>(gravity);
    std::vector<pin::JointIndex> number(1, 0);
    if (base != nullptr) {
        number[0] = model.addJoint(0, pin::JointModelFreeFlyer(), pin::SE3::Identity(), "base");
        model.appendBodyToJoint(number[0], inertia(base), pin::SE3::Identity());
    }
    for (int i = 0; i < n; i++) {
        const Eigen::Matrix4d T = Eigen::Map<const Eigen::Matrix<double, 4, 4, Eigen::RowMajor>>(places + 16 * i);
        const pin::JointIndex parent = number[static_cast<std::size_t>(parents[i] + 1)];
        number.push_back(model.addJoint(parent, pin::JointModelRZ(), pin::SE3(T), "joint" + std::to_string(i)));
        model.appendBodyToJoint(number.back(), inertia(bodies + 13 * i), pin::SE3::Identity());
    }
    model.armature.tail(n) = Eigen::Map<const Eigen::VectorXd>(armature, n);
    data = std::make_unique<pin::Data>(model);
}

#define Q Input(q, model.nq)
#define V(x) Input(x, model.nv)

void tree_inverse_dynamics(const double *q, const double *v, const double *a, double *f)
{
    Eigen::Map<Eigen::VectorXd>(f, model.nv) = pin::rnea(model, *data, Q, V(v), V(a));
}

void tree_mass_matrix(const double *q, double *M)
{
    pin::crba(model, *data, Q);
    Eigen::Map<Matrix> full(M, model.nv, model.nv);
    full = data->M;
    full.triangularView<Eigen::StrictlyLower>() = full.transpose();
}

void tree_forward_dynamics(const double *q, const double *v, const double *f, double *a)
{
    Eigen::Map<Eigen::VectorXd>(a, model.nv) = pin::aba(model, *data, Q, V(v), V(f));
}

/* All second derivatives of the torques by (q, q), (rate, q), (rate, rate) and (acceleration, q), n^3 each, with the torque
   as the first index. */
void tree_second_derivatives(const double *q, const double *v, const double *a, double *out)
{
    static pin::Data::Tensor3x qq, vv, qv, aq;
    const int n = model.nv;
    for (pin::Data::Tensor3x *tensor : {&qq, &vv, &qv, &aq}) {
        if (tensor->dimension(0) != n) {
            tensor->resize(n, n, n);
        }
        tensor->setZero();
    }
    pin::ComputeRNEASecondOrderDerivatives(model, *data, Q, V(v), V(a), qq, vv, qv, aq);
    for (int i = 0; i < n; i++) {
        for (int j = 0; j < n; j++) {
            for (int k = 0; k < n; k++, out++) {
                out[0] = qq(i, j, k);
                out[n * n * n] = qv(i, k, j);
                out[2 * n * n * n] = vv(i, j, k);
                out[3 * n * n * n] = aq(i, j, k);
            }
        }
    }
}

static std::vector<int> drives;
static int passive[2];
static pin::JointIndex pinned[2];
static Eigen::Vector3d pins[2];

/* the joints with drives, the two passive joints, the joints whose bodies the pin joins, and its places in their axes */
void loop_setup(int n, const int *driven, const int *others, const int *carriers, const double *points)
{
    drives.assign(driven, driven + n);
    for (int k = 0; k < 2; k++) {
        passive[k] = others[k];
        pinned[k] = static_cast<pin::JointIndex>(carriers[k] + 1);
        pins[k] = Eigen::Map<const Eigen::Vector3d>(points + 3 * k);
    }
}

/* Torques of the drives, for positions q of all joints that close the loop, rates and accelerations of the drives: those
   of the passive joints follow from the Jacobian of the gap between both sides of the pin, which is in one plane. */
void loop_inverse_dynamics(const double *q, const double *rates, const double *accelerations, double *tau)
{
    static Eigen::VectorXd v, a, f;
    static pin::Data::Matrix6x columns;
    static Eigen::Matrix<double, 2, Eigen::Dynamic> gap, ratios;
    const int n = static_cast<int>(drives.size());
    gap.setZero(2, model.nv);
    ratios.resize(2, n);
    v.resize(model.nv);
    a.setZero(model.nv);
    pin::computeJointJacobians(model, *data, Q);
    const Eigen::Matrix<double, 2, 3> plane = data->oMi[passive[0] + 1].rotation().transpose().topRows<2>();
    for (int k = 0; k < 2; k++) {
        const Eigen::Vector3d place = data->oMi[pinned[k]].act(pins[k]);
        columns.setZero(6, model.nv);
        pin::getJointJacobian(model, *data, pinned[k], pin::WORLD, columns);
        for (int j = 0; j < model.nv; j++) {
            const Eigen::Vector3d linear = columns.col(j).head<3>(), angular = columns.col(j).tail<3>();
            gap.col(j) += (k ? -1.0 : 1.0) * (plane * (linear + angular.cross(place)));
        }
    }
    Eigen::Matrix2d own;
    own << gap.col(passive[0]), gap.col(passive[1]);
    const Eigen::Matrix2d inverse = own.inverse();
    Eigen::Vector2d second = Eigen::Vector2d::Zero();
    for (int k = 0; k < n; k++) {
        ratios.col(k) = -inverse * gap.col(drives[k]);
        v[drives[k]] = rates[k];
        a[drives[k]] = accelerations[k];
        second += gap.col(drives[k]) * accelerations[k];
    }
    const Eigen::Vector2d turning = ratios * Eigen::Map<const Eigen::VectorXd>(rates, n);
    v[passive[0]] = turning[0];
    v[passive[1]] = turning[1];
    pin::forwardKinematics(model, *data, Q, v, Eigen::VectorXd::Zero(model.nv));
    for (int k = 0; k < 2; k++) {
        const pin::Motion &motion = data->v[pinned[k]], &rate = data->a[pinned[k]];
        const Eigen::Vector3d along = motion.linear() + motion.angular().cross(pins[k]);
        const Eigen::Vector3d curved = rate.linear() + rate.angular().cross(pins[k]) + motion.angular().cross(along);
        second += (k ? -1.0 : 1.0) * (plane * (data->oMi[pinned[k]].rotation() * curved));
    }
    const Eigen::Vector2d faster = -inverse * second;
    a[passive[0]] = faster[0];
    a[passive[1]] = faster[1];
    f = pin::rnea(model, *data, Q, v, a);
    for (int k = 0; k < n; k++) {
        tau[k] = f[drives[k]] + ratios(0, k) * f[passive[0]] + ratios(1, k) * f[passive[1]];
    }
}
}
