#include <cmath>
#include <memory>
#include <utility>
#include <vector>

#include <pybind11/eigen.h>
#include <pybind11/pybind11.h>

#include "estimator/interface/residual.hpp"

namespace py = pybind11;
namespace est = orbid::estimator;

namespace {

/// y(t) = a exp(-k t), read at times t: the residual of docs/estimator.md, to be compared with the same in Python.
class Decay final : public est::Residual {
public:
    Decay(Eigen::VectorXd t, Eigen::VectorXd y) : t_(std::move(t)), y_(std::move(y)) {
        est::Group readings;
        readings.name = "readings";
        readings.unit = "V";
        readings.scale.value = 0.0;  // from the residuals, as a group in Python begins
        readings.distribution = est::StudentErrors{};
        readings.floor = 1e-4;
        groups_ = {readings};
        est::BlockLayout record;
        record.label = "run 1";
        record.group.assign(static_cast<std::size_t>(y_.size()), 0);
        layout_ = {record};
    }
    [[nodiscard]] std::string_view type() const override { return "decay"; }
    [[nodiscard]] const std::vector<est::Group>& groups() const override { return groups_; }
    [[nodiscard]] const std::vector<est::BlockLayout>& layout() const override { return layout_; }
    [[nodiscard]] est::LatentStructure structure() const override { return est::LatentStructure::none; }
    [[nodiscard]] std::vector<Eigen::VectorXd> initial_latents() const override { return {Eigen::VectorXd()}; }
    [[nodiscard]] std::vector<est::BlockValue> evaluate(const est::ActiveSet& active, const Eigen::VectorXd& theta,
                                                        const std::vector<Eigen::VectorXd>& /*latents*/,
                                                        bool derivatives) const override {
        std::vector<est::BlockValue> values(1);
        if (!active.layout[0].active) return values;
        // One exponential at a time, by the C library as Python's math.exp: vectorised ones differ in the last digit.
        Eigen::ArrayXd shape(t_.size());
        for (Eigen::Index i = 0; i < t_.size(); ++i)
            shape[i] = std::exp(-theta[1] * t_[i]);
        values[0].e = y_.array() - theta[0] * shape;
        if (!derivatives) return values;
        values[0].e_theta.resize(y_.size(), 2);
        values[0].e_theta << -shape, theta[0] * t_.array() * shape;
        values[0].e_z.resize(y_.size(), 0);
        return values;
    }

private:
    Eigen::VectorXd t_;
    Eigen::VectorXd y_;
    std::vector<est::Group> groups_;
    std::vector<est::BlockLayout> layout_;
};

}  // namespace

PYBIND11_MODULE(decay_twin, module) {
    py::module_::import("orbid");
    py::class_<Decay, est::Residual, std::shared_ptr<Decay>>(module, "Decay")
        .def(py::init<Eigen::VectorXd, Eigen::VectorXd>());
}
