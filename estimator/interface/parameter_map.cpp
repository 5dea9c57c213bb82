#include "estimator/interface/parameter_map.hpp"

#include <cassert>
#include <cmath>
#include <stdexcept>
#include <string>

namespace orbid::estimator {

ParameterMap::ParameterMap(std::vector<ParameterSource> sources, Eigen::Index reduced)
    : sources_(std::move(sources)), reduced_(reduced) {
    for (std::size_t i = 0; i < sources_.size(); ++i) {
        const ParameterSource& source = sources_[i];
        const std::string who = "parameter " + std::to_string(i) + ": ";
        if (source.reduced < -1 || source.reduced >= reduced_)
            throw std::invalid_argument(who + "source " + std::to_string(source.reduced) + " must lie in [-1, " +
                                        std::to_string(reduced_) + ")");
        if (!std::isfinite(source.value))
            throw std::invalid_argument(who + (source.reduced < 0 ? "pinned value" : "factor") + " must be finite");
        if (source.reduced >= 0 && source.value == 0.0)
            throw std::invalid_argument(who + "factor = 0: must not be zero, pin the parameter instead");
    }
}

ParameterMap ParameterMap::identity(Eigen::Index count) {
    return pinned(count, {});
}

ParameterMap ParameterMap::pinned(Eigen::Index count, const std::vector<std::pair<Eigen::Index, double>>& pins) {
    std::vector<ParameterSource> sources(static_cast<std::size_t>(count), ParameterSource{0, 1.0});
    for (const auto& pin : pins) {
        if (pin.first < 0 || pin.first >= count)
            throw std::invalid_argument("pinned parameter " + std::to_string(pin.first) + ": must lie in [0, " +
                                        std::to_string(count) + ")");
        ParameterSource& source = sources[static_cast<std::size_t>(pin.first)];
        if (source.reduced < 0)
            throw std::invalid_argument("pinned parameter " + std::to_string(pin.first) + " is given twice");
        source = {-1, pin.second};
    }
    Eigen::Index reduced = 0;
    for (ParameterSource& source : sources)
        if (source.reduced >= 0) source.reduced = reduced++;
    return {std::move(sources), reduced};
}

Eigen::VectorXd ParameterMap::expand(const Eigen::VectorXd& reduced) const {
    assert(reduced.size() == reduced_);
    Eigen::VectorXd theta(full_size());
    for (Eigen::Index i = 0; i < theta.size(); ++i) {
        const ParameterSource& source = sources_[static_cast<std::size_t>(i)];
        theta[i] = source.reduced < 0 ? source.value : source.value * reduced[source.reduced];
    }
    return theta;
}

Eigen::MatrixXd ParameterMap::reduce_columns(const Eigen::MatrixXd& columns) const {
    assert(columns.cols() == full_size());
    Eigen::MatrixXd reduced = Eigen::MatrixXd::Zero(columns.rows(), reduced_);
    for (Eigen::Index i = 0; i < columns.cols(); ++i) {
        const ParameterSource& source = sources_[static_cast<std::size_t>(i)];
        if (source.reduced >= 0) reduced.col(source.reduced) += source.value * columns.col(i);
    }
    return reduced;
}

Eigen::MatrixXd ParameterMap::jacobian() const {
    return reduce_columns(Eigen::MatrixXd::Identity(full_size(), full_size()));
}

}  // namespace orbid::estimator
