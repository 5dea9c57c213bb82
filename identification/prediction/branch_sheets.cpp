#include "identification/prediction/branch_sheets.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>

#include <fmt/format.h>

namespace orbid::identification {

namespace {

using Eigen::Index;
using Eigen::VectorXd;
using periodic::Bifurcation;

/// Nodes nearer to each other than this share of an interval are one: a located bifurcation beside a step.
constexpr double same_node = 1e-3;

std::size_t start_of(const periodic::Branch& branch, double start, const VectorXd& near) {
    std::size_t best = 0;
    double least = std::numeric_limits<double>::infinity();
    double width = 0.0;
    for (const periodic::BranchPoint& point : branch.points)
        width = std::max(width, std::abs(point.parameter - start));
    for (std::size_t k = 0; k < branch.points.size(); ++k) {
        const periodic::BranchPoint& point = branch.points[k];
        // Far apart in the parameter counts before the distance of states, in units of their own size.
        const double off = std::abs(point.parameter - start) / std::max(width, 1e-300);
        const double distance =
            (off > 1e-9 ? 1e6 * off : 0.0) + (point.orbit.points.col(0) - near).norm() / (near.norm() + 1e-300);
        if (distance < least) {
            least = distance;
            best = k;
        }
    }
    return best;
}

/// Weights of Lagrange's polynomial through the nodes at x.
VectorXd lagrange(const std::vector<double>& nodes, double x) {
    VectorXd weights = VectorXd::Ones(std::ssize(nodes));
    for (std::size_t i = 0; i < nodes.size(); ++i)
        for (std::size_t j = 0; j < nodes.size(); ++j)
            if (i != j) weights(static_cast<Index>(i)) *= (x - nodes[j]) / (nodes[i] - nodes[j]);
    return weights;
}

}  // namespace

BranchSheets::BranchSheets(const periodic::Branch& branch, const Eigen::MatrixXd& quantities, double start,
                           const VectorXd& near)
    : quantities_(quantities) {
    std::size_t at = start_of(branch, start, near);
    for (const periodic::BranchPoint& point : branch.points) {
        parameter_.push_back(point.parameter);
        arclength_.push_back(point.arclength);
    }
    const std::size_t last = parameter_.size() - 1;
    const std::size_t before = at < last ? at : at - 1;
    reversed_ = parameter_[before + 1] < parameter_[before];
    if (reversed_) {
        std::reverse(parameter_.begin(), parameter_.end());
        std::reverse(arclength_.begin(), arclength_.end());
        for (double& s : arclength_)
            s = -s;
        quantities_ = quantities.rowwise().reverse().eval();
        at = last - at;
    }
    find_sheets(at);
    find_marks(branch, at);
}

void BranchSheets::find_sheets(std::size_t start) {
    const std::size_t count = parameter_.size();
    interval_sheets_.assign(count - 1, 0);
    const auto rises = [&](std::size_t k) { return parameter_[k + 1] > parameter_[k]; };
    // Towards larger arclengths, then towards smaller ones.
    bool rising = true;
    int sheet = 0;
    for (std::size_t k = start; k + 1 < count; ++k) {
        if (parameter_[k + 1] != parameter_[k] && rises(k) != rising) {
            rising = !rising;
            ++sheet;
        }
        interval_sheets_[k] = sheet;
    }
    highest_ = sheet;
    rising = true;
    sheet = 0;
    for (std::size_t k = start; k-- > 0;) {
        if (parameter_[k + 1] != parameter_[k] && rises(k) != rising) {
            rising = !rising;
            --sheet;
        }
        interval_sheets_[k] = sheet;
    }
    lowest_ = sheet;
    sheets_.resize(count);
    for (std::size_t k = 0; k < count; ++k) {
        const int left = interval_sheets_[k > 0 ? k - 1 : 0];
        const int right = interval_sheets_[k + 1 < count ? k : count - 2];
        sheets_[k] = std::abs(left) < std::abs(right) ? left : right;
    }
}

void BranchSheets::find_marks(const periodic::Branch& branch, std::size_t start) {
    const std::size_t count = parameter_.size();
    std::map<std::string, int> seen;
    const auto add = [&](std::size_t k, int side, const std::string& kind) {
        const int number = side * ++seen[fmt::format("{}{}", side, kind)];
        marks_.push_back({fmt::format("{} {:+d}", kind, number), kind, parameter_[k]});
    };
    const auto look = [&](std::size_t k, int side) {
        const Bifurcation kind = branch.points[place_of(k)].bifurcation;
        if (kind != Bifurcation::none) add(k, side, std::string(periodic::name(kind)));
    };
    for (std::size_t k = start + 1; k < count; ++k)
        look(k, 1);
    for (std::size_t k = start; k-- > 0;)
        look(k, -1);
    const auto end = [&](periodic::BranchEnd how, std::size_t k, int side) {
        if (how == periodic::BranchEnd::equilibrium || how == periodic::BranchEnd::other_branch)
            add(k, side, std::string(periodic::name(how)));
    };
    end(reversed_ ? branch.first : branch.last, count - 1, 1);
    end(reversed_ ? branch.last : branch.first, 0, -1);
}

std::optional<VectorXd> BranchSheets::at(int sheet, double parameter, Index linear) const {
    for (std::size_t k = 0; k + 1 < parameter_.size(); ++k) {
        if (interval_sheets_[k] != sheet) continue;
        const double a = parameter_[k], b = parameter_[k + 1];
        if (!((a - parameter) * (b - parameter) <= 0.0) || a == b) continue;
        const double length = arclength_[k + 1] - arclength_[k];
        std::vector<std::size_t> nodes{k, k + 1};
        if (k > 0 && arclength_[k] - arclength_[k - 1] > same_node * length) nodes.push_back(k - 1);
        if (k + 2 < parameter_.size() && arclength_[k + 2] - arclength_[k + 1] > same_node * length)
            nodes.push_back(k + 2);
        std::vector<double> places;
        VectorXd values(std::ssize(nodes));
        for (std::size_t i = 0; i < nodes.size(); ++i) {
            places.push_back(arclength_[nodes[i]] - arclength_[k]);
            values(static_cast<Index>(i)) = parameter_[nodes[i]];
        }
        // Bisection: the polynomial takes the value between its two nodes.
        double low = 0.0, high = length;
        for (int i = 0; i < 60; ++i) {
            const double middle = 0.5 * (low + high);
            const bool beyond = (lagrange(places, middle).dot(values) - parameter) * (b - a) > 0.0;
            (beyond ? high : low) = middle;
        }
        const VectorXd weights = lagrange(places, low);
        VectorXd result = VectorXd::Zero(quantities_.rows());
        for (std::size_t i = 0; i < nodes.size(); ++i)
            result += weights(static_cast<Index>(i)) * quantities_.col(static_cast<Index>(nodes[i]));
        const double share = low / length;
        result.tail(linear) = (1.0 - share) * quantities_.col(static_cast<Index>(k)).tail(linear) +
                              share * quantities_.col(static_cast<Index>(k + 1)).tail(linear);
        return result;
    }
    return std::nullopt;
}

}  // namespace orbid::identification
