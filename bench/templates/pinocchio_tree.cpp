/* Pinocchio's recursions over a tree of revolute joints, on a base at rest or a free flyer, behind plain C functions. */
#define BOOST_MPL_CFG_NO_PREPROCESSED_HEADERS /* its joint types outnumber the lists that Boost has preprocessed */
#define BOOST_MPL_LIMIT_LIST_SIZE 30
#define BOOST_FUSION_INVOKE_MAX_ARITY 10
#include <memory>
#include <pinocchio/algorithm/aba.hpp>
#include <pinocchio/algorithm/crba.hpp>
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
   mass, centre (3), tensor about the centre (9) in joint axes; base: that of a floating base, or null. */
void tree_setup(int n, const int *parents, const double *places, const double *bodies, const double *base, const double *gravity)
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
}
