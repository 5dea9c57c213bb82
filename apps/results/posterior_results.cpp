#include "apps/results/posterior_results.hpp"

#include <array>
#include <iterator>

#include <fmt/format.h>

#include "apps/documents/json_text.hpp"
#include "apps/results/result_file.hpp"

namespace orbid::apps {

namespace {

using Json = nlohmann::ordered_json;

Json sampled_json(const estimator::SampledQuantity& x) {
    Json out;
    out["mean"] = x.mean;
    out["sd"] = x.sd;
    out["unit"] = x.unit;
    out["interval95"] = {x.quantiles.front(), x.quantiles.back()};
    out["median"] = x.quantiles[x.quantiles.size() / 2];
    out["probabilities"] = estimator::sample_probabilities;
    out["quantiles"] = x.quantiles;
    out["mean_error"] = x.mean_error;
    out["sd_error"] = x.sd_error;
    out["quantile_errors"] = x.quantile_errors;
    out["rhat"] = x.rhat;
    out["bulk_size"] = x.bulk_size;
    out["tail_size"] = x.tail_size;
    return out;
}

Json sampled_list(const std::vector<estimator::SampledQuantity>& list) {
    Json out = Json::object();
    for (const auto& x : list)
        out[x.name] = sampled_json(x);
    return out;
}

Json sample_json(const estimator::PosteriorSample& sample) {
    Json out;
    out["status"] = name(sample.status);
    out["message"] = sample.message;
    out["trusted"] = sample.trusted;
    out["distrust"] = json_or_null(sample.distrust);
    out["parameters"] = sampled_list(sample.parameters);
    out["derived"] = sampled_list(sample.derived);
    out["errors"] = sampled_list(sample.errors);
    out["chains"] = Json::array();
    for (std::size_t c = 0; c < sample.chains.size(); ++c) {
        const estimator::SampledChain& chain = sample.chains[c];
        out["chains"].push_back({{"draws", c < sample.draws.size() ? sample.draws[c].rows() : 0},
                                 {"step", chain.step},
                                 {"acceptance", chain.acceptance},
                                 {"divergences", chain.divergences},
                                 {"saturated", chain.saturated},
                                 {"energy_mixing", chain.energy_mixing},
                                 {"warm_up_evaluations", chain.warm_up_evaluations},
                                 {"evaluations", chain.evaluations}});
    }
    out["worst_rhat"] = sample.worst_rhat;
    out["least_size"] = sample.least_size;
    out["draws"] = "posterior.csv";
    return out;
}

Json end_names(std::string_view lower, std::string_view upper) {
    return Json::array({lower, upper});
}

Json profile_json(const estimator::Profile& profile) {
    Json out;
    out["known"] = profile.known;
    out["message"] = profile.message;
    out["value"] = profile.value;
    // An open end is infinite: null.
    out["interval95"] = {profile.lower, profile.upper};
    out["ends"] = end_names(estimator::name(profile.lower_end), estimator::name(profile.upper_end));
    out["method"] = profile.method;
    out["threshold"] = profile.threshold;
    out["improvement"] = profile.improvement;
    out["unit"] = profile.unit;
    out["evaluations"] = profile.evaluations;
    out["points"] = json_list(profile.points, [](const auto& point) -> Json {
        return {{"value", point.value}, {"objective", point.objective}, {"signed_root", point.signed_root}};
    });
    out["failed"] = profile.failed;
    return out;
}

Json marginal_json(const estimator::Marginal& marginal) {
    Json out;
    out["known"] = marginal.known;
    out["message"] = marginal.message;
    out["mean"] = marginal.mean;
    out["sd"] = marginal.sd;
    out["median"] = marginal.median;
    out["interval95"] = {marginal.lower95, marginal.upper95};
    out["ends"] = end_names(estimator::name(marginal.lower_end), estimator::name(marginal.upper_end));
    out["unit"] = marginal.unit;
    out["full_hessian"] = marginal.full_hessian;
    out["failed_points"] = marginal.failed_points;
    out["evaluations"] = marginal.evaluations;
    out["points"] = json_list(marginal.points, [](const auto& point) -> Json {
        return {{"value", point.value}, {"coordinate", point.u}, {"log_density", point.log_density}};
    });
    return out;
}

Json optima_json(const PosteriorResults& results) {
    Json out = Json::array();
    for (const estimator::Optimum& optimum : results.optima) {
        Json entry{{"objective", optimum.objective}, {"parameters", Json::object()}, {"starts", optimum.starts}};
        for (std::size_t i = 0; i < results.parameters.size(); ++i)
            entry["parameters"][results.parameters[i]] = optimum.theta[static_cast<Eigen::Index>(i)];
        out.push_back(std::move(entry));
    }
    return out;
}

Json runs_json(const PosteriorResults& results) {
    Json out = Json::array();
    for (const estimator::StartedRun& run : results.runs) {
        Json from = Json::object();
        for (std::size_t i = 0; i < results.parameters.size() && static_cast<Eigen::Index>(i) < run.from.size(); ++i)
            from[results.parameters[i]] = run.from[static_cast<Eigen::Index>(i)];
        out.push_back({{"start", run.start},
                       {"from", std::move(from)},
                       {"status", estimator::name(run.status)},
                       {"message", run.message},
                       {"objective", run.objective},
                       {"optimum", run.optimum < 0 ? Json(nullptr) : Json(run.optimum)}});
    }
    return out;
}

Json test_json(const estimator::TestResult& test) {
    return {{"statistic", test.statistic}, {"p", test.p}};
}

Json diagnostic_json(const GroupDiagnostic& group) {
    const estimator::ResidualDiagnostic& d = group.diagnostic;
    Json out;
    out["count"] = d.count;
    out["mean"] = d.mean;
    out["sd"] = d.sd;
    out["skewness"] = d.skewness;
    out["kurtosis"] = d.kurtosis;
    out["normality"] = {{"shapiro_wilk", test_json(d.shapiro_wilk)},
                        {"anderson_darling", test_json(d.anderson_darling)},
                        {"skewness", test_json(d.skewness_test)},
                        {"kurtosis", test_json(d.kurtosis_test)}};
    out["mean_test"] = test_json(d.mean_test);
    out["lag1"] = d.lag1;
    out["ljung_box"] = test_json(d.ljung_box);
    out["runs"] = test_json(d.runs);
    out["outliers"] = json_list(group.outliers, [](const OutlierRecord& x) -> Json {
        return {{"block", x.block}, {"record", x.record}, {"studentised", x.studentised}, {"p", x.p}};
    });
    return out;
}

/// A block that was asked for and could not be done says why.
Json refused_json(const PosteriorResults& results, std::string_view block) {
    for (const auto& [name, reason] : results.refused)
        if (name == block) return {{"status", "refused"}, {"message", reason}};
    return nullptr;
}

}  // namespace

std::string_view name(estimator::SampleStatus status) {
    constexpr std::array<std::string_view, 3> names{"complete", "interrupted", "failed"};
    return names[static_cast<std::size_t>(status)];
}

void add_posterior(const PosteriorResults& results, Json& result) {
    result["posterior"] = results.sample ? sample_json(*results.sample) : refused_json(results, "posterior");
    result["profile"] = refused_json(results, "profile");
    for (const auto& profile : results.profiles)
        result["profile"][profile.name] = profile_json(profile);
    result["marginals"] = refused_json(results, "marginals");
    for (const auto& marginal : results.marginals)
        result["marginals"][marginal.name] = marginal_json(marginal);
    result["intervals"] = results.bootstrap ? bootstrap_json(*results.bootstrap) : refused_json(results, "intervals");
    result["optima"] = results.runs.empty() ? Json(nullptr) : optima_json(results);
    result["starts"] = results.runs.empty() ? Json(nullptr) : runs_json(results);
    result["diagnostics"] = Json::object();
    for (const GroupDiagnostic& group : results.diagnostics)
        result["diagnostics"][group.group] = diagnostic_json(group);
}

std::string draws_text(const estimator::PosteriorSample& sample) {
    fmt::memory_buffer out;
    fmt::format_to(std::back_inserter(out), "chain,draw");
    for (const std::string& name : sample.names)
        fmt::format_to(std::back_inserter(out), ",{}", csv_cell(name));
    fmt::format_to(std::back_inserter(out), ",minus_log_density\n");
    for (std::size_t c = 0; c < sample.draws.size(); ++c) {
        const Eigen::MatrixXd& draws = sample.draws[c];
        for (Eigen::Index i = 0; i < draws.rows(); ++i) {
            fmt::format_to(std::back_inserter(out), "{},{}", c + 1, i + 1);
            for (Eigen::Index j = 0; j < draws.cols(); ++j)
                fmt::format_to(std::back_inserter(out), ",{}", draws(i, j));
            fmt::format_to(std::back_inserter(out), ",{}\n", sample.potential[c][i]);
        }
    }
    return fmt::to_string(out);
}

Json evidence_json(const LogEvidence& evidence) {
    return {{"value", json_or_null(evidence.value)},
            {"reason", evidence.value ? Json(nullptr) : Json(evidence.reason)}};
}

}  // namespace orbid::apps
