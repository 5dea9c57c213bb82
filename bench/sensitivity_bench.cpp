// One period of the paper's pendulum with all sensitivities (2 states, 5 parameters), on one core:
//   - over the plain period, the same steps on values only;
//   - against CVODES of SUNDIALS (Adams, forward sensitivities by equations on paper), tolerances chosen for equal
//   error.

#include <cvodes/cvodes.h>
#include <nvector/nvector_serial.h>
#include <sundials/sundials_context.h>
#include <sunnonlinsol/sunnonlinsol_fixedpoint.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <limits>
#include <numbers>
#include <vector>

#include "bench/ratio.hpp"
#include "models/catalogue/parametric_pendulum.hpp"
#include "models/trajectories/flow.hpp"

namespace orbid::bench {

namespace {

/// Of our own, so that all that is compiled here is compiled with the flags of this file.
struct Pendulum : models::PendulumOn<models::Support::crank> {};

constexpr double turn = 2.0 * std::numbers::pi;
constexpr std::size_t directions = 7;  // phi, phi_dot; l, k2, k3, omega, epsilon
constexpr std::array<std::ptrdiff_t, 5> free_parameters{1, 3, 4, 7, 8};
using Theta = std::array<double, 9>;
using Start = std::array<double, 2>;

/// State and sensitivities after one period; column j = derivative in direction j.
struct Period {
    std::array<double, 2> state;
    std::array<double, 2 * directions> sensitivity;
};

double processor_seconds() {
    timespec now;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
    return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

/// Processor time of one call, the shortest of several rounds over all starts: what disturbs only adds.
template <class Call>
double microseconds(const std::vector<Start>& starts, const Call& call) {
    double best = std::numeric_limits<double>::infinity();
    for (int round = 0; round < 5; ++round) {
        const double begin = processor_seconds();
        for (const Start& start : starts)
            call(start);
        best = std::min(best, processor_seconds() - begin);
    }
    return 1e6 * best / static_cast<double>(starts.size());
}

// ---- ours

models::FlowStart flow_start(const Start& start, const Theta& theta, double tolerance) {
    return {start.data(), 0.0, theta.data(), models::Clock::phase, {tolerance, tolerance, 100000}};
}

Period ours(const Start& start, const Theta& theta, double tolerance) {
    Period period;
    std::array<double, 2> stopped;
    const models::FlowOutput output{period.state.data(), stopped.data(), period.sensitivity.data(), nullptr};
    models::in_passes<Pendulum>(free_parameters.size(), [&]<std::size_t N>(std::size_t first) {
        (void)models::flow_pass<Pendulum, N>(flow_start(start, theta, tolerance), std::span(&turn, 1), free_parameters,
                                             first, output);
    });
    return period;
}

Period plain(const Start& start, const Theta& theta, double tolerance) {
    Period period{};
    models::Trajectory<Pendulum, 0> trajectory(theta, start, 0.0, models::Clock::phase, {tolerance, tolerance, 100000});
    (void)trajectory.advance(turn);
    period.state = trajectory.state();
    return period;
}

// ---- CVODES

/// The equations (M1), (M2) for k1 = 0 and their derivatives, by hand.
struct Equations {
    Theta theta;

    struct Terms {
        double inertia, forcing, by_l, by_omega, by_epsilon;
    };
    [[nodiscard]] double stiffness(double phase) const {
        const auto& [m, l, k1, k2, k3, g, A, w, e] = theta;
        const double s = std::sin(phase), square = s * s, root = 1.0 - e * e * square;
        const double rod = e * (1.0 - 2.0 * square + e * e * square * square) / (root * std::sqrt(root));
        return g / l - A * w * w / l * (std::cos(phase) + rod);
    }
    [[nodiscard]] Terms terms(double phase) const {
        const auto& [m, l, k1, k2, k3, g, A, w, e] = theta;
        const double s = std::sin(phase), square = s * s, root = 1.0 - e * e * square;
        const double power = root * std::sqrt(root), sum = 1.0 - 2.0 * square + e * e * square * square;
        const double shape = std::cos(phase) + e * sum / power;
        const double P = g / l - A * w * w / l * shape;
        return {m * l * l, P, -P / l, -2.0 * A * w / l * shape,
                -A * w * w / l *
                    ((sum + 2.0 * e * e * square * square) / power + 3.0 * e * e * square * sum / (power * root))};
    }
};

int rhs(realtype phase, N_Vector state, N_Vector slope, void* data) {
    const auto& equations = *static_cast<const Equations*>(data);
    const auto& [m, l, k1, k2, k3, g, A, w, e] = equations.theta;
    const double *x = NV_DATA_S(state), v = x[1];
    double* f = NV_DATA_S(slope);
    f[0] = v / w;
    f[1] = -(v * (k2 + k3 * std::abs(v)) / (m * l * l) + equations.stiffness(phase) * std::sin(x[0])) / w;
    return 0;
}

int sensitivity_rhs(int, realtype phase, N_Vector state, N_Vector, N_Vector* s, N_Vector* ds, void* data, N_Vector,
                    N_Vector) {
    const auto& equations = *static_cast<const Equations*>(data);
    const auto& [m, l, k1, k2, k3, g, A, w, e] = equations.theta;
    const auto at = equations.terms(phase);
    const double *x = NV_DATA_S(state), v = x[1];
    const double sine = std::sin(x[0]), cosine = std::cos(x[0]), inverse = 1.0 / w;
    const double by_phi = -at.forcing * cosine * inverse;
    const double by_v = -(k2 + 2.0 * k3 * std::abs(v)) / at.inertia * inverse;
    const double drag = v * (k2 + k3 * std::abs(v)) / at.inertia;
    const std::array<double, 2> f{v * inverse, -(drag + at.forcing * sine) * inverse};
    const std::array<double, directions> a{0.0,
                                           0.0,
                                           (2.0 * drag / l - at.by_l * sine) * inverse,
                                           -v / at.inertia * inverse,
                                           -v * std::abs(v) / at.inertia * inverse,
                                           (-at.by_omega * sine - f[1]) * inverse,
                                           -at.by_epsilon * sine * inverse};
    for (std::size_t j = 0; j < directions; ++j) {
        const double* sj = NV_DATA_S(s[j]);
        double* d = NV_DATA_S(ds[j]);
        d[0] = sj[1] * inverse - (j == 5 ? f[0] * inverse : 0.0);
        d[1] = by_phi * sj[0] + by_v * sj[1] + a[j];
    }
    return 0;
}

/// One integrator, used again for every period.
class Cvodes {
public:
    Cvodes(const Theta& theta, double tolerance, int method, bool control_sensitivities) : equations_{theta} {
        SUNContext_Create(nullptr, &context_);
        x_ = N_VNew_Serial(2, context_);
        N_VEnableFusedOps_Serial(x_, 1);
        s_ = N_VCloneVectorArray(directions, x_);
        memory_ = CVodeCreate(CV_ADAMS, context_);
        CVodeInit(memory_, rhs, 0.0, x_);
        CVodeSStolerances(memory_, tolerance, tolerance);
        CVodeSetUserData(memory_, &equations_);
        CVodeSetMaxNumSteps(memory_, 1000000);
        CVodeSetErrFile(memory_, nullptr);  // a tolerance that it refuses is no news here
        solver_ = SUNNonlinSol_FixedPoint(x_, 0, context_);
        CVodeSetNonlinearSolver(memory_, solver_);
        reset({0.0, 0.0});
        CVodeSensInit(memory_, directions, method, sensitivity_rhs, s_);
        std::array<realtype, directions> scale{1.0, 1.0};
        for (std::size_t j = 2; j < directions; ++j)
            scale[j] = theta[static_cast<std::size_t>(free_parameters[j - 2])];
        CVodeSetSensParams(memory_, nullptr, scale.data(), nullptr);
        CVodeSensEEtolerances(memory_);
        CVodeSetSensErrCon(memory_, control_sensitivities ? 1 : 0);
        if (method == CV_SIMULTANEOUS) {
            sensitivity_solver_ = SUNNonlinSol_FixedPointSens(directions + 1, x_, 0, context_);
            CVodeSetNonlinearSolverSensSim(memory_, sensitivity_solver_);
        } else {
            sensitivity_solver_ = SUNNonlinSol_FixedPointSens(directions, x_, 0, context_);
            CVodeSetNonlinearSolverSensStg(memory_, sensitivity_solver_);
        }
        method_ = method;
    }
    Cvodes(const Cvodes&) = delete;
    Cvodes& operator=(const Cvodes&) = delete;
    ~Cvodes() {
        CVodeFree(&memory_);
        SUNNonlinSolFree(solver_);
        SUNNonlinSolFree(sensitivity_solver_);
        N_VDestroyVectorArray(s_, directions);
        N_VDestroy(x_);
        SUNContext_Free(&context_);
    }

    Period operator()(const Start& start) {
        reset(start);
        CVodeReInit(memory_, 0.0, x_);
        CVodeSensReInit(memory_, method_, s_);
        CVodeSetStopTime(memory_, turn);
        realtype reached = 0.0;
        Period period;
        if (CVode(memory_, turn, x_, &reached, CV_NORMAL) < 0) {
            period.state.fill(std::numeric_limits<double>::quiet_NaN());
            period.sensitivity.fill(std::numeric_limits<double>::quiet_NaN());
            return period;
        }
        CVodeGetSens(memory_, &reached, s_);
        std::copy_n(NV_DATA_S(x_), 2, period.state.begin());
        for (std::size_t j = 0; j < directions; ++j)
            std::copy_n(NV_DATA_S(s_[j]), 2, period.sensitivity.begin() + static_cast<std::ptrdiff_t>(2 * j));
        return period;
    }
    [[nodiscard]] long steps() const {
        long count = 0;
        CVodeGetNumSteps(memory_, &count);
        return count;
    }

private:
    void reset(const Start& start) {
        std::copy_n(start.begin(), 2, NV_DATA_S(x_));
        for (std::size_t j = 0; j < directions; ++j) {
            NV_DATA_S(s_[j])[0] = j == 0 ? 1.0 : 0.0;
            NV_DATA_S(s_[j])[1] = j == 1 ? 1.0 : 0.0;
        }
    }

    Equations equations_;
    SUNContext context_ = nullptr;
    N_Vector x_ = nullptr;
    N_Vector* s_ = nullptr;
    void* memory_ = nullptr;
    SUNNonlinearSolver solver_ = nullptr, sensitivity_solver_ = nullptr;
    int method_ = CV_STAGGERED;
};

// ---- errors

/// Medians over all starts of the error of the state, and of that of the sensitivities relative to their size in units
/// of a relative change of each parameter.
struct Errors {
    double state, sensitivity;
};

template <class Call>
Errors errors(const std::vector<Start>& starts, const std::vector<Period>& exact, const Theta& theta,
              const Call& call) {
    std::vector<double> state, sensitivity;
    for (std::size_t i = 0; i < starts.size(); ++i) {
        const Period period = call(starts[i]);
        state.push_back(std::hypot(period.state[0] - exact[i].state[0], period.state[1] - exact[i].state[1]));
        double worst = 0.0, size = 0.0;
        for (std::size_t k = 0; k < period.sensitivity.size(); ++k) {
            const std::size_t j = k / 2;
            const double unit = j < 2 ? 1.0 : theta[static_cast<std::size_t>(free_parameters[j - 2])];
            worst = std::max(worst, unit * std::abs(period.sensitivity[k] - exact[i].sensitivity[k]));
            size = std::max(size, unit * std::abs(exact[i].sensitivity[k]));
        }
        sensitivity.push_back(worst / size);
    }
    const auto median = [](std::vector<double>& values) {
        for (double& value : values)
            if (std::isnan(value)) value = std::numeric_limits<double>::infinity();
        std::sort(values.begin(), values.end());
        return values[values.size() / 2];
    };
    return {median(state), median(sensitivity)};
}

void compare(const std::vector<Start>& starts, const std::vector<Period>& exact, const Theta& theta, double tolerance) {
    const auto ours_at = [&](const Start& start) { return ours(start, theta, tolerance); };
    const Errors error = errors(starts, exact, theta, ours_at);
    const double time = microseconds(starts, ours_at);
    const double plain_time = microseconds(starts, [&](const Start& start) { return plain(start, theta, tolerance); });
    std::printf("tolerance %.0e: median errors %.1e (state) %.1e (sensitivities, relative)\n", tolerance, error.state,
                error.sensitivity);
    std::printf("  ours      %8.2f us, %.2f x the plain period of %.2f us\n", time, time / plain_time, plain_time);
    // The loosest tolerance of each of its four ways that is no less accurate than ours, on a ladder of factors
    // 10^0.25.
    double best = std::numeric_limits<double>::infinity();
    for (const int method : {CV_STAGGERED, CV_SIMULTANEOUS})
        for (const bool controlled : {false, true}) {
            const char* name = method == CV_STAGGERED ? "staggered" : "simultaneous";
            bool found = false;
            for (double peer_tolerance = tolerance; peer_tolerance > 1e-16 && !found;
                 peer_tolerance *= std::pow(10.0, -0.25)) {
                Cvodes peer(theta, peer_tolerance, method, controlled);
                const auto call = [&](const Start& start) { return peer(start); };
                const Errors peer_error = errors(starts, exact, theta, call);
                if (!(peer_error.state <= error.state && peer_error.sensitivity <= error.sensitivity)) continue;
                found = true;
                const double peer_time = microseconds(starts, call);
                best = std::min(best, peer_time);
                std::printf(
                    "  CVODES    %8.2f us, %s, sensitivities %s, tolerance %.0e, errors %.1e %.1e: %.1f x ours\n",
                    peer_time, name, controlled ? "controlled" : "not controlled", peer_tolerance, peer_error.state,
                    peer_error.sensitivity, peer_time / time);
            }
            if (!found)
                std::printf("  CVODES    %s, sensitivities %s: not as accurate at any tolerance\n", name,
                            controlled ? "controlled" : "not controlled");
        }
    char task[80];
    std::snprintf(task, sizeof task, "a period with 5 derivatives alone, tolerance %.0e, equal error", tolerance);
    print_ratio(task, "CVODES", time, best, "us");
}

}  // namespace

}  // namespace orbid::bench

int main() {
    using namespace orbid::bench;
    Theta theta;
    for (std::size_t i = 0; i < theta.size(); ++i)
        theta[i] = Pendulum::parameters[i].default_value;
    // Points of the chaotic attractor, one after the other.
    std::vector<Start> starts;
    std::vector<Period> exact;
    Start x{0.1, 3.0};
    for (int i = 0; i < 84; ++i) {
        const Period period = ours(x, theta, 1e-15);
        if (i >= 20) {
            starts.push_back(x);
            exact.push_back(period);
        }
        x = {std::remainder(period.state[0], turn), period.state[1]};
    }
    std::printf("one period of the parametric pendulum, 2 states, 5 parameters, %zu points of the attractor\n",
                starts.size());
    for (const double tolerance : {1e-8, 1e-10, 1e-12})
        compare(starts, exact, theta, tolerance);
    return 0;
}
