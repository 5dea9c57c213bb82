#include "estimator/identifiability.hpp"

#include <cmath>
#include <cstdio>
#include <limits>

#include <Eigen/SVD>

namespace orbid::estimator {

namespace {

/// A component below this share of the largest is noise of the derivatives, not part of the direction.
constexpr double tiny_component = 1e-6;

/// Reduced echelon form of the directions (rows), so that each has as few components as possible; largest component 1.
std::vector<NullDirection> sparse_basis(Eigen::MatrixXd rows) {
    const Eigen::Index count = rows.rows();
    for (Eigen::Index k = 0; k < count; ++k) {
        Eigen::Index row = 0;
        Eigen::Index column = 0;
        rows.bottomRows(count - k).cwiseAbs().maxCoeff(&row, &column);
        rows.row(k).swap(rows.row(k + row));
        rows.row(k) /= rows(k, column);
        for (Eigen::Index i = 0; i < count; ++i)
            if (i != k) rows.row(i) -= rows(i, column) * rows.row(k);
    }
    std::vector<NullDirection> directions;
    for (Eigen::Index k = 0; k < count; ++k) {
        Eigen::VectorXd components = rows.row(k).transpose();
        const double largest = components.lpNorm<Eigen::Infinity>();
        // Of components equal to rounding the first sets the sign.
        Eigen::Index first = 0;
        while (std::abs(components[first]) < (1.0 - tiny_component) * largest)
            ++first;
        components /= components[first];
        for (double& component : components)
            if (std::abs(component) < tiny_component) component = 0.0;
        directions.push_back({components});
    }
    return directions;
}

}  // namespace

Identifiability identifiability(const Eigen::MatrixXd& r, const BoundedStep& step, const Eigen::VectorXd& size,
                                const Eigen::VectorXd& column_size) {
    const Eigen::Index q = r.cols();
    const auto free = static_cast<Eigen::Index>(step.free.size());
    const Subspace& space = step.space;
    Identifiability result;
    result.undetermined.assign(static_cast<std::size_t>(q), false);
    result.data_variance = Eigen::VectorXd::Constant(q, std::numeric_limits<double>::infinity());

    Eigen::MatrixXd scaled(r.rows(), free);
    for (Eigen::Index k = 0; k < free; ++k) {
        const Eigen::Index i = step.free[static_cast<std::size_t>(k)];
        scaled.col(k) = r.col(i) * column_size[i];
    }
    if (free > 0) result.singular_values = Eigen::JacobiSVD<Eigen::MatrixXd>(scaled).singularValues();

    const auto relative = [&](const Eigen::MatrixXd& directions) {
        Eigen::MatrixXd rows = Eigen::MatrixXd::Zero(directions.cols(), q);
        for (Eigen::Index k = 0; k < free; ++k) {
            const Eigen::Index i = step.free[static_cast<std::size_t>(k)];
            rows.col(i) = directions.row(k).transpose() / (space.unit[k] * size[i]);
        }
        return rows;
    };
    Eigen::MatrixXd null(free, space.prior.cols() + space.flat.cols());
    null << space.prior, space.flat;
    result.null_directions = sparse_basis(relative(null));
    result.undecided = sparse_basis(relative(space.flat));
    for (const NullDirection& direction : result.undecided)
        for (Eigen::Index i = 0; i < q; ++i)
            if (direction.components[i] != 0.0) result.undetermined[static_cast<std::size_t>(i)] = true;

    for (Eigen::Index k = 0; k < free; ++k) {
        const Eigen::Index i = step.free[static_cast<std::size_t>(k)];
        bool in_null = false;
        for (const NullDirection& direction : result.null_directions)
            in_null = in_null || direction.components[i] != 0.0;
        if (in_null) continue;
        const Eigen::Index rank = space.data.cols();
        result.data_variance[i] =
            space.data.row(k).transpose().cwiseQuotient(space.singular_values.head(rank)).squaredNorm() /
            (space.unit[k] * space.unit[k]);
    }
    return result;
}

std::string in_words(const NullDirection& direction, const std::vector<FreeParameter>& parameters) {
    std::vector<std::string> names;
    std::string changes;
    for (std::size_t i = 0; i < parameters.size(); ++i) {
        const double component = direction.components[static_cast<Eigen::Index>(i)];
        if (component == 0.0) continue;
        char text[32];
        std::snprintf(text, sizeof text, " %+.3g", component);
        changes += (names.empty() ? "" : ", ") + parameters[i].name + text;
        names.push_back(parameters[i].name);
    }
    if (names.size() == 1) return names[0] + " has no effect on the data";
    std::string list = names[0];
    for (std::size_t i = 1; i < names.size(); ++i)
        list += (i + 1 == names.size() ? " and " : ", ") + names[i];
    return list + " enter only in a combination: " + changes + " leaves the data unchanged";
}

}  // namespace orbid::estimator
