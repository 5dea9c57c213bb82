#pragma once

/// The peer of identification_bench and estimator_bench: Ceres, and Boost.Odeint as its users use it, in a shared
/// library of their own. Only numbers pass. Both sides include Eigen with settings of their own. Linked into one
/// program, they shared one copy of Eigen's functions, and matrices were freed in another way than they had been
/// allocated. Nothing of Eigen may therefore be seen from outside, neither of this library nor of its users.
#ifdef __cplusplus
extern "C" {
#endif

#define ORBID_PEER __attribute__((visibility("default")))

/// Multiple shooting; see ShootingTask for the meaning of each.
struct peer_shooting_task {
    int pendulum; /* 0: Lorenz' equations */
    int intervals;
    const int* ends;         /* per interval: where its durations end in the list of all */
    const double* durations; /* [s], of all intervals one after the other */
    const double* readings;  /* per duration: Lorenz 3, pendulum 1; nan = not read */
    const int* linked;       /* per interval: the next one continues it */
    double reading_sd;
    const double* matching_sd;
    double tolerance;
    int iterations;
    int threads;
};

struct peer_shooting_result {
    int converged;
    int iterations;
    double cost, readings_chi2, seconds, iterating, derivatives, linear;
};

/// Ceres with its default trust region (Levenberg-Marquardt) and SPARSE_NORMAL_CHOLESKY, one residual block per
/// interval on theta, its node and the next node.
/// @param theta  start, then the solution
/// @param nodes  the same of the states, n per interval
ORBID_PEER struct peer_shooting_result peer_solve_shooting(const struct peer_shooting_task* task, double* theta,
                                                           double* nodes);

/// One flow with sensitivities over each interval on this thread.
/// @param ends  states at the last durations, n per interval
/// @return microseconds of one
ORBID_PEER double peer_flow_microseconds(const struct peer_shooting_task* task, const double* theta,
                                         const double* nodes, double* ends);

/// Residuals of part `part` at x and, unless null, their Jacobian row by row.
typedef void (*peer_residuals)(void* problem, int part, const double* x, double* e, double* jacobian);

struct peer_least_squares_task {
    int parameters;
    int parts;
    const int* residuals; /* per part */
    peer_residuals function;
    void* problem;       /* handed to it */
    const double* lower; /* null: no bounds */
    const double* upper;
    int threads;
};

struct peer_least_squares_result {
    int converged;
    int iterations;
    double seconds;
};

/// Ceres with its default trust region and DENSE_QR, one residual block per part. Tolerances: function 1e-16, gradient
/// 1e-16, parameters 1e-14; with the defaults (1e-6, 1e-10, 1e-8) Ceres is faster and solves fewer of the NIST problems
/// to four digits.
/// @param x  start, then the solution
ORBID_PEER struct peer_least_squares_result peer_solve_least_squares(const struct peer_least_squares_task* task,
                                                                     double* x);

#ifdef __cplusplus
}
#endif
