#include "identification/structure/null_direction.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include <fmt/format.h>

#include "models/arithmetic/eigenvalues.hpp"
#include "models/arithmetic/orthogonal_factor.hpp"

namespace orbid::identification {

namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

/// Components below this part of the largest are noise of the derivatives.
constexpr double negligible = 1e-5;

/// An orthonormal basis of the columns, each row first divided by its unit.
MatrixXd orthonormal(const MatrixXd& directions, const VectorXd& unit) {
    const MatrixXd relative = unit.cwiseInverse().asDiagonal() * directions;
    const MatrixXd lengthened = relative * relative.colwise().norm().cwiseInverse().asDiagonal();
    return models::HouseholderFactor(lengthened).q().leftCols(directions.cols());
}

/// The directions that all spaces have in common: eigenvectors of the mean projector with eigenvalue 1.
MatrixXd common(const std::vector<MatrixXd>& bases) {
    const Index n = bases.front().rows();
    MatrixXd projector = MatrixXd::Zero(n, n);
    for (const MatrixXd& basis : bases)
        projector += basis * basis.transpose() / static_cast<double>(bases.size());
    const models::SymmetricEigen eigen = models::symmetric_eigen(projector);
    // The eigenvalue falls by the square of the angle.
    const Index count = (eigen.values.array() > 1.0 - negligible * negligible * 100.0).count();
    return eigen.vectors.rightCols(count);
}

/// Reduced echelon form of the directions (rows). Pivots: the last shared unknown that is left, unless its entry is
/// negligible. Rows without a pivot among the shared unknowns are left out.
struct Echelon {
    MatrixXd rows;
    std::vector<Index> pivots;
};

Echelon echelon(MatrixXd rows, Index shared, const std::vector<Index>& taken) {
    constexpr double pivotal = 1e-3, noise = 1e-6;
    Echelon result;
    Index done = 0;
    const double size = rows.size() == 0 ? 0.0 : rows.cwiseAbs().maxCoeff();
    for (Index j = shared - 1; j >= 0 && done < rows.rows(); --j) {
        if (std::find(taken.begin(), taken.end(), j) != taken.end()) continue;
        const double left = rows.bottomRows(rows.rows() - done).cwiseAbs().maxCoeff();
        if (!(left > noise * size)) break;
        Index best = 0;
        if (!(rows.col(j).tail(rows.rows() - done).cwiseAbs().maxCoeff(&best) > pivotal * left)) continue;
        rows.row(done).swap(rows.row(done + best));
        rows.row(done) /= rows(done, j);
        for (Index i = 0; i < rows.rows(); ++i)
            if (i != done) rows.row(i) -= rows(i, j) * rows.row(done);
        result.pivots.push_back(j);
        ++done;
    }
    result.rows = rows.topRows(done);
    return result;
}

/// The components times the smallest whole number that makes all of them whole; false if there is none up to 12.
bool made_whole(VectorXd& components) {
    constexpr int most = 12;
    for (int factor = 1; factor <= most; ++factor) {
        const VectorXd scaled = components * factor;
        const VectorXd whole = scaled.array().round();
        if ((scaled - whole).cwiseAbs().maxCoeff() > 1e-3) continue;
        components = whole;
        return true;
    }
    return false;
}

std::string listed(const std::vector<std::string>& names) {
    if (names.size() < 2) return names.empty() ? "" : names.front();
    return fmt::format("{} and {}", fmt::join(names.begin(), names.end() - 1, ", "), names.back());
}

std::string scaled_name(const std::string& name, double power) {
    const double size = std::abs(power);
    const std::string factor = size == 1.0 ? "c" : fmt::format("c^{:.0f}", size);
    return power > 0.0 ? factor + " " + name : name + " / " + factor;
}

std::string shifted_name(const std::string& name, double multiple) {
    const double size = std::abs(multiple);
    return fmt::format("{} {} {}c", name, multiple > 0.0 ? "+" : "-",
                       std::abs(size - 1.0) < 1e-3 ? std::string() : fmt::format("{:.4g} ", size));
}

std::string text_of(const UndeterminedDirection& direction) {
    using Kind = UndeterminedDirection::Kind;
    const auto& names = direction.unknowns;
    if (direction.kind == Kind::no_effect) return names.front() + " has no effect on the readings";
    if (direction.kind == Kind::combination)
        return fmt::format("only combinations of {} are determined, not each of them", listed(names));
    std::vector<std::string> images;
    for (std::size_t i = 0; i < names.size(); ++i)
        images.push_back(direction.kind == Kind::scaling ? scaled_name(names[i], direction.components[i])
                                                         : shifted_name(names[i], direction.components[i]));
    return fmt::format("{} can be {} together: ({}) -> ({}) changes no reading", listed(names),
                       direction.kind == Kind::scaling ? "scaled" : "shifted", fmt::join(names, ", "),
                       fmt::join(images, ", "));
}

/// A direction from its components, shared unknowns first; in words states come first.
UndeterminedDirection direction_of(UndeterminedDirection::Kind kind, VectorXd components,
                                   const std::vector<std::string>& names, Index shared, Index pivot) {
    using Kind = UndeterminedDirection::Kind;
    UndeterminedDirection direction;
    direction.kind = kind;
    direction.held = names[static_cast<std::size_t>(pivot)];
    const double largest = components.cwiseAbs().maxCoeff();
    for (double& component : components)
        if (!(std::abs(component) > negligible * 10.0 * largest)) component = 0.0;
    if (kind == Kind::scaling && !made_whole(components)) direction.kind = Kind::combination;
    std::vector<Index> order;
    for (Index i = shared; i < components.size(); ++i)
        order.push_back(i);
    for (Index i = 0; i < shared; ++i)
        order.push_back(i);
    double sign = 0.0;
    for (const Index i : order) {
        const double component = components[i];
        if (component == 0.0) continue;
        if (sign == 0.0) sign = std::copysign(1.0, component);
        direction.unknowns.push_back(names[static_cast<std::size_t>(i)]);
        direction.components.push_back(sign * component);
    }
    if (direction.unknowns.size() == 1) direction.kind = Kind::no_effect;
    if (direction.kind == Kind::shift) {
        const double first = direction.components.front();
        for (double& component : direction.components)
            component /= first;
    }
    direction.text = text_of(direction);
    return direction;
}

/// Whether a direction is none of the span of those found before.
bool independent(const MatrixXd& found, const VectorXd& candidate) {
    if (candidate.norm() == 0.0) return false;
    if (found.rows() == 0) return true;
    MatrixXd columns(found.cols(), found.rows() + 1);
    for (Index i = 0; i < found.rows(); ++i)
        columns.col(i) = found.row(i).normalized().transpose();
    columns.col(found.rows()) = candidate.normalized();
    return models::PivotedFactor(columns, 1e-4).rank() == columns.cols();
}

/// What has been named, in units of the values at the first course.
struct Named {
    std::vector<UndeterminedDirection> list;
    std::vector<Index> pivots;
    MatrixXd rows;

    void add(UndeterminedDirection direction, Index pivot, const VectorXd& relative) {
        list.push_back(std::move(direction));
        pivots.push_back(pivot);
        rows.conservativeResize(rows.rows() + 1, relative.size());
        rows.bottomRows(1) = relative.transpose();
    }
};

}  // namespace

std::string_view name(UndeterminedDirection::Kind kind) {
    constexpr std::array names{"no_effect", "scaling", "shift", "combination"};
    return names[static_cast<std::size_t>(kind)];
}

std::vector<UndeterminedDirection> named_directions(const std::vector<NullSpace>& spaces,
                                                    const std::vector<std::string>& names, Index shared) {
    using Kind = UndeterminedDirection::Kind;
    const NullSpace& first = spaces.front();
    const Index count = first.directions.cols();
    Named named;
    const VectorXd mean_size = first.values.cwiseAbs();
    const auto constant = [&](Kind kind) {
        std::vector<MatrixXd> bases;
        for (const NullSpace& space : spaces)
            bases.push_back(orthonormal(space.directions, kind == Kind::scaling ? space.values : mean_size));
        const Echelon found = echelon(common(bases).transpose(), shared, named.pivots);
        for (Index k = 0; k < found.rows.rows() && std::ssize(named.list) < count; ++k) {
            const VectorXd relative = found.rows.row(k).transpose();
            VectorXd at_first = relative;
            if (kind == Kind::shift) at_first = at_first.cwiseProduct(mean_size).cwiseQuotient(first.values);
            if (!independent(named.rows, at_first)) continue;
            VectorXd components = relative;
            if (kind == Kind::shift) components = components.cwiseProduct(mean_size);
            const Index pivot = found.pivots[static_cast<std::size_t>(k)];
            named.add(direction_of(kind, components, names, shared, pivot), pivot, at_first);
        }
    };
    constant(Kind::scaling);
    constant(Kind::shift);
    if (std::ssize(named.list) == count) return named.list;
    // What is left: the whole space without the pivots taken.
    MatrixXd rows = orthonormal(first.directions, first.values).transpose();
    if (!named.pivots.empty()) {
        const MatrixXd own = named.rows(Eigen::all, named.pivots);
        rows -= rows(Eigen::all, named.pivots) * models::PivotedFactor(own).solve(named.rows);
    }
    const Echelon rest = echelon(rows, shared, named.pivots);
    for (Index k = 0; k < rest.rows.rows() && std::ssize(named.list) < count; ++k) {
        VectorXd components = rest.rows.row(k).transpose();
        const Index pivot = rest.pivots[static_cast<std::size_t>(k)];
        if (!independent(named.rows, components)) continue;
        named.add(direction_of(Kind::combination, components, names, shared, pivot), pivot, components);
    }
    return named.list;
}

}  // namespace orbid::identification
