#include "estimator/problem/problem.hpp"

#include <algorithm>
#include <cmath>

#include "models/arithmetic/eigenvalues.hpp"

namespace orbid::estimator {

PriorModel prior_at(const Problem& problem, const Eigen::VectorXd& u) {
    const Eigen::Index q = u.size();
    PriorModel model{0.0, Eigen::VectorXd::Zero(q), {}, Eigen::MatrixXd::Zero(q, q)};
    Eigen::VectorXd curvature(q);
    for (Eigen::Index i = 0; i < q; ++i) {
        const auto index = static_cast<std::size_t>(i);
        const PriorTerm term = problem.coordinates[index].term(problem.parameters[index].prior, u[i]);
        model.value += term.value;
        model.gradient[i] = term.gradient;
        model.second(i, i) = term.second;
        curvature[i] = term.curvature;
    }
    const Eigen::Index curved = (curvature.array() > 0.0).count();
    Eigen::Index row = 0;
    model.rows = Eigen::MatrixXd::Zero(curved, q);
    for (Eigen::Index i = 0; i < q; ++i)
        if (curvature[i] > 0.0) model.rows(row++, i) = std::sqrt(curvature[i]);
    for (const Problem::Joint& joint : problem.joint_priors) {
        const auto count = static_cast<Eigen::Index>(joint.place.size());
        std::vector<Coordinate> coordinates;
        Eigen::VectorXd own(count);
        for (Eigen::Index i = 0; i < count; ++i) {
            const Eigen::Index place = joint.place[static_cast<std::size_t>(i)];
            coordinates.push_back(problem.coordinates[static_cast<std::size_t>(place)]);
            own[i] = u[place];
        }
        const JointPriorTerm term = joint_term(joint.prior, coordinates, own);
        model.value += term.value;
        const models::SymmetricEigen eigen = models::symmetric_eigen(term.curvature);
        const Eigen::MatrixXd root = eigen.values.cwiseMax(0.0).cwiseSqrt().asDiagonal() * eigen.vectors.transpose();
        model.rows.conservativeResize(row + count, q);
        model.rows.bottomRows(count).setZero();
        for (Eigen::Index i = 0; i < count; ++i) {
            const Eigen::Index place = joint.place[static_cast<std::size_t>(i)];
            model.gradient[place] += term.gradient[i];
            model.rows.col(place).tail(count) = root.col(i);
            for (Eigen::Index j = 0; j < count; ++j)
                model.second(place, joint.place[static_cast<std::size_t>(j)]) += term.second(i, j);
        }
        row += count;
    }
    return model;
}

Eigen::VectorXd sizes(const Problem& problem, const Eigen::VectorXd& theta) {
    Eigen::VectorXd size(theta.size());
    for (Eigen::Index i = 0; i < theta.size(); ++i) {
        const auto index = static_cast<std::size_t>(i);
        size[i] = problem.coordinates[index].size(theta[i], problem.parameters[index].typical_size);
    }
    return size;
}

std::vector<bool> free_errors(const Problem& problem, const BlockSet& set) {
    std::vector<bool> free(problem.errors.size(), false);
    if (set.provisional) return free;
    for (const NoiseModel& law : problem.laws) {
        const bool data = std::all_of(law.channels.begin(), law.channels.end(),
                                      [&set](int channel) { return set.count[channel] > 0.0; });
        for (std::size_t j = 0; j < law.coordinates.size(); ++j)
            free[static_cast<std::size_t>(law.first) + j] = data && law.coordinates[j].estimate;
    }
    return free;
}

}  // namespace orbid::estimator
