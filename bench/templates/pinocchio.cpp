/* Pinocchio's algorithms behind the benchmark's plain C functions. The model is built from numbers at start-up. */
#define BOOST_MPL_CFG_NO_PREPROCESSED_HEADERS /* its joint types outnumber the lists that Boost has preprocessed */
#define BOOST_MPL_LIMIT_LIST_SIZE 30
#define BOOST_FUSION_INVOKE_MAX_ARITY 10
#include <memory>
#include <pinocchio/algorithm/aba.hpp>
#include <pinocchio/algorithm/crba.hpp>
#include <pinocchio/algorithm/frames.hpp>
#include <pinocchio/algorithm/jacobian.hpp>
#include <pinocchio/algorithm/regressor.hpp>
#include <pinocchio/algorithm/rnea.hpp>

namespace pin = pinocchio;
using Input = Eigen::Map<const Eigen::VectorXd>;
using Matrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

static pin::Model model;
static std::unique_ptr<pin::Data> data;
static pin::FrameIndex tip;
static Eigen::MatrixXd jacobian;

static pin::SE3 placement(const double *T)
{
    return pin::SE3(Eigen::Map<const Eigen::Matrix<double, 4, 4, Eigen::RowMajor>>(T));
}

extern "C" {

/* joints: n placements (16 each) in the joint before; bodies: n times mass, centre (3), tensor about the centre (9) in
   joint axes; tool: 16. All revolute about z. */
void pinocchio_setup(int n, const double *joints, const double *bodies, const double *tool, const double *gravity)
{
    model = pin::Model();
    model.gravity.linear() = Eigen::Map<const Eigen::Vector3d>(gravity);
    pin::JointIndex parent = 0;
    for (int i = 0; i < n; i++) {
        const double *body = bodies + 13 * i;
        parent = model.addJoint(parent, pin::JointModelRZ(), placement(joints + 16 * i), "joint" + std::to_string(i));
        model.appendBodyToJoint(parent, pin::Inertia(body[0], Eigen::Map<const Eigen::Vector3d>(body + 1),
                                                     Eigen::Map<const Eigen::Matrix3d>(body + 4)), pin::SE3::Identity());
    }
    tip = model.addFrame(pin::Frame("tip", parent, 0, placement(tool), pin::OP_FRAME));
    data = std::make_unique<pin::Data>(model);
    jacobian = Eigen::MatrixXd::Zero(6, n);
}

#define N model.nv
#define Q Input(in, N)
#define DQ Input(in + N, N)
#define DDQ Input(in + 2 * N, N)
#define OUT Eigen::Map<Eigen::VectorXd>(out, N)

void pinocchio_inverse_dynamics(const double *in, double *out) { OUT = pin::rnea(model, *data, Q, DQ, DDQ); }

void pinocchio_bias(const double *in, double *out) { OUT = pin::nonLinearEffects(model, *data, Q, DQ); }

void pinocchio_gravity(const double *in, double *out) { OUT = pin::computeGeneralizedGravity(model, *data, Q); }

void pinocchio_forward_dynamics(const double *in, double *out) { OUT = pin::aba(model, *data, Q, DQ, DDQ); }

void pinocchio_mass_matrix(const double *in, double *out)
{
    pin::crba(model, *data, Q);
    Eigen::Map<Matrix> M(out, N, N);
    M = data->M;
    M.triangularView<Eigen::StrictlyLower>() = M.transpose();
}

void pinocchio_coriolis_matrix(const double *in, double *out)
{
    Eigen::Map<Matrix>(out, N, N) = pin::computeCoriolisMatrix(model, *data, Q, DQ);
}

void pinocchio_standard_regressor(const double *in, double *out)
{
    Eigen::Map<Matrix>(out, N, 10 * N) = pin::computeJointTorqueRegressor(model, *data, Q, DQ, DDQ);
}

void pinocchio_kinematics(const double *in, double *out)
{
    pin::computeJointJacobians(model, *data, Q);
    pin::getFrameJacobian(model, *data, tip, pin::LOCAL_WORLD_ALIGNED, jacobian);
    Eigen::Map<Eigen::Matrix<double, 4, 4, Eigen::RowMajor>> pose(out);
    pose = data->oMf[tip].toHomogeneousMatrix();
    Eigen::Map<Matrix>(out + 16, 6, N) = jacobian;
}
}
