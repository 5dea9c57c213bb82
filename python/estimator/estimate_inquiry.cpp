#include <optional>
#include <utility>

#include <pybind11/stl.h>

#include "estimator/exploration/marginal.hpp"
#include "estimator/exploration/profile.hpp"
#include "estimator/sampling/posterior_sample.hpp"
#include "python/conversion/arrays.hpp"
#include "python/conversion/named_arguments.hpp"
#include "python/conversion/properties.hpp"
#include "python/estimator/error_model.hpp"
#include "python/estimator/python_residual.hpp"
#include "python/estimator/result_bindings.hpp"

namespace orbid::python {

namespace py = pybind11;
using namespace pybind11::literals;

namespace {

/// Options of the same estimate, once more with its residuals.
struct Inquiry {
    explicit Inquiry(const EstimateResult& result) : call(residuals(result)), options(result.options) {}

    /// What `inquire` returns, which may stop early.
    template <class Inquire>
    auto answered(const Inquire& inquire) {
        std::optional<decltype(inquire())> answer;
        (void)call.compute([&](const std::function<bool()>& stopped) {
            options.interrupted = stopped;
            answer.emplace(inquire());
        });
        return std::move(*answer);
    }

    static const std::vector<py::object>& residuals(const EstimateResult& result) {
        if (result.residuals.empty())
            throw py::value_error(
                "the estimate of multi_start() or identify() has no residuals: estimate() once more from it");
        return result.residuals;
    }

    ResidualCall call;
    estimator::EstimateOptions options;
};

template <class Point>
py::array_t<double> column(const std::vector<Point>& points, double Point::*which) {
    std::vector<double> values;
    for (const Point& point : points)
        values.push_back(point.*which);
    return array(std::move(values));
}

template <class Point>
py::array_t<double> thetas(const std::vector<Point>& points) {
    Eigen::MatrixXd values(points.empty() ? 0 : points.front().theta.size(), std::ssize(points));
    for (std::size_t k = 0; k < points.size(); ++k)
        values.col(static_cast<Eigen::Index>(k)) = points[k].theta;
    return array(std::move(values));
}

py::dict profile_dict(const estimator::Profile& profile) {
    return py::dict(
        "unit"_a = profile.unit, "known"_a = profile.known, "message"_a = profile.message, "value"_a = profile.value,
        "interval"_a = py::make_tuple(profile.lower, profile.upper),
        "ends"_a = py::make_tuple(std::string(name(profile.lower_end)), std::string(name(profile.upper_end))),
        "threshold"_a = profile.threshold, "method"_a = profile.method,
        "values"_a = column(profile.points, &estimator::ProfilePoint::value),
        "objectives"_a = column(profile.points, &estimator::ProfilePoint::objective),
        "signed_roots"_a = column(profile.points, &estimator::ProfilePoint::signed_root),
        "theta"_a = thetas(profile.points), "failed"_a = profile.failed, "improvement"_a = profile.improvement,
        "evaluations"_a = profile.evaluations);
}

py::dict profiles(const EstimateResult& result, const py::kwargs& keywords) {
    NamedArguments given("profiles", keywords);
    estimator::ProfileOptions how;
    given.take({{"names", how.names},
                {"level", how.level},
                {"tolerance", how.tolerance},
                {"reach", how.reach},
                {"curve_points", how.curve_points},
                {"maximum_points", how.maximum_points, 1}});
    given.finish();
    Inquiry inquiry(result);
    const auto found = inquiry.answered([&] {
        return estimator::profiles(result.parameters, inquiry.call.residuals(), inquiry.options, result.estimate, how);
    });
    return by_name(found, &estimator::Profile::name, profile_dict);
}

py::dict marginal_dict(const estimator::Marginal& marginal) {
    return py::dict(
        "unit"_a = marginal.unit, "known"_a = marginal.known, "message"_a = marginal.message, "mean"_a = marginal.mean,
        "sd"_a = marginal.sd, "median"_a = marginal.median,
        "interval95"_a = py::make_tuple(marginal.lower95, marginal.upper95),
        "ends"_a = py::make_tuple(std::string(name(marginal.lower_end)), std::string(name(marginal.upper_end))),
        "values"_a = column(marginal.points, &estimator::MarginalPoint::value),
        "coordinates"_a = column(marginal.points, &estimator::MarginalPoint::u),
        "log_densities"_a = column(marginal.points, &estimator::MarginalPoint::log_density),
        "theta"_a = thetas(marginal.points), "failed_points"_a = marginal.failed_points,
        "evaluations"_a = marginal.evaluations);
}

py::dict marginals(const EstimateResult& result, const py::kwargs& keywords) {
    NamedArguments given("marginals", keywords);
    estimator::MarginalOptions how;
    given.take({{"names", how.names},
                {"step", how.step},
                {"fall", how.fall},
                {"reach", how.reach},
                {"maximum_points", how.maximum_points, 1}});
    given.take("full_hessian", how.full_hessian);
    given.finish();
    Inquiry inquiry(result);
    const auto found = inquiry.answered([&] {
        return estimator::marginals(result.parameters, inquiry.call.residuals(), inquiry.options, result.estimate, how);
    });
    return by_name(found, &estimator::Marginal::name, marginal_dict);
}

py::dict quantity_dict(const estimator::SampledQuantity& quantity) {
    return py::dict("unit"_a = quantity.unit, "mean"_a = quantity.mean, "sd"_a = quantity.sd,
                    "quantiles"_a = quantity.quantiles, "mean_error"_a = quantity.mean_error,
                    "sd_error"_a = quantity.sd_error, "rhat"_a = quantity.rhat, "bulk_size"_a = quantity.bulk_size,
                    "tail_size"_a = quantity.tail_size);
}

py::dict quantity_dicts(const std::vector<estimator::SampledQuantity>& quantities) {
    return by_name(quantities, &estimator::SampledQuantity::name, quantity_dict);
}

py::dict chain_dict(const estimator::SampledChain& chain) {
    return py::dict("step"_a = chain.step, "acceptance"_a = chain.acceptance, "divergences"_a = chain.divergences,
                    "saturated"_a = chain.saturated, "energy_mixing"_a = chain.energy_mixing,
                    "evaluations"_a = chain.evaluations);
}

py::dict sample_dict(const estimator::PosteriorSample& sample) {
    constexpr const char* statuses[] = {"complete", "interrupted", "failed"};
    const auto draws = [](const Eigen::MatrixXd& chain) { return array(Eigen::MatrixXd(chain.transpose())); };
    return py::dict("status"_a = statuses[static_cast<std::size_t>(sample.status)], "message"_a = sample.message,
                    "trusted"_a = sample.trusted, "distrust"_a = sample.distrust,
                    "parameters"_a = quantity_dicts(sample.parameters), "derived"_a = quantity_dicts(sample.derived),
                    "errors"_a = quantity_dicts(sample.errors), "names"_a = sample.names,
                    "draws"_a = listed(sample.draws, draws), "chains"_a = listed(sample.chains, chain_dict),
                    "worst_rhat"_a = sample.worst_rhat, "least_size"_a = sample.least_size);
}

py::dict sample(const EstimateResult& result, const py::kwargs& keywords) {
    NamedArguments given("sample", keywords);
    estimator::SampleOptions how;
    given.take({{"chains", how.chains, 1},
                {"warm_up", how.warm_up},
                {"draws", how.draws, 1},
                {"seed", how.seed},
                {"acceptance", how.acceptance},
                {"maximum_depth", how.maximum_depth, 1},
                {"spread", how.spread}});
    given.finish();
    Inquiry inquiry(result);
    const auto derived = derived_quantities(result.derived, inquiry.call);
    return sample_dict(inquiry.answered([&] {
        how.interrupted = inquiry.options.interrupted;
        return estimator::sample_posterior(result.parameters, inquiry.call.residuals(), derived, inquiry.options,
                                           result.estimate, how);
    }));
}

}  // namespace

void bind_estimate_inquiry(py::class_<EstimateResult, std::shared_ptr<EstimateResult>>& result) {
    result
        .def("profiles", &profiles,
             "Profile likelihood, dict by name: value, interval, ends, values, objectives, signed_roots, theta.\n\n"
             "names (parameters, \"group.scale\", \"group.dof\"; all unless given), level (0.95), tolerance, reach,\n"
             "curve_points, maximum_points. After Ctrl-C what is known by then.")
        .def(
            "marginals", &marginals,
            "Nested Laplace, dict by name: mean, sd, median, interval95, values, coordinates, log_densities, theta.\n\n"
            "names, step, fall, reach, maximum_points, full_hessian. After Ctrl-C what is known by then.")
        .def("sample", &sample,
             "Draws from the posterior by the No-U-Turn sampler: parameters, derived, errors (mean, sd, quantiles at\n"
             "0.025, 0.25, 0.5, 0.75, 0.975, rhat), names, draws: one array (draws, names) per chain.\n\n"
             "chains (4), warm_up (500), draws (1000), seed (1), acceptance, maximum_depth, spread. After Ctrl-C the\n"
             "draws made by then, status \"interrupted\".");
}

}  // namespace orbid::python
