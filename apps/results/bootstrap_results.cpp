#include <cmath>
#include <iterator>

#include <fmt/format.h>

#include "apps/documents/json_text.hpp"
#include "apps/results/posterior_results.hpp"
#include "apps/results/result_file.hpp"
#include "apps/results/summary_table.hpp"

namespace orbid::apps {

namespace {

using Json = nlohmann::ordered_json;

Json quantity_json(const estimator::BootstrapQuantity& x) {
    Json out;
    out["value"] = x.value;
    out["unit"] = x.unit;
    out["sd"] = x.sd;
    out["bootstrap_sd"] = x.bootstrap_sd;
    out["bias"] = x.bias;
    out["bias_error"] = x.bias_error;
    out["bias_in_sds"] = x.bias / x.bootstrap_sd;
    out["percentile95"] = {x.percentile_lower, x.percentile_upper};
    out["studentised95"] = {x.studentised_lower, x.studentised_upper};
    out["remark"] = json_or_null(x.remark);
    return out;
}

Json quantities_json(const std::vector<estimator::BootstrapQuantity>& list) {
    Json out = Json::object();
    for (const auto& x : list)
        out[x.name] = quantity_json(x);
    return out;
}

std::vector<const estimator::BootstrapQuantity*> all_quantities(const estimator::Bootstrap& bootstrap) {
    std::vector<const estimator::BootstrapQuantity*> all;
    for (const auto* list : {&bootstrap.parameters, &bootstrap.derived, &bootstrap.errors})
        for (const auto& x : *list)
            all.push_back(&x);
    return all;
}

std::string interval_text(double lower, double upper, double sd) {
    if (!std::isfinite(lower) || !std::isfinite(upper)) return {};
    return fmt::format("[{}, {}]", with_digits_of(lower, sd), with_digits_of(upper, sd));
}

std::string drawn_from(const estimator::Bootstrap& bootstrap) {
    if (bootstrap.kind == estimator::ErrorDraw::parametric) return "errors of the estimated laws";
    return bootstrap.block > 1 ? fmt::format("residuals in blocks of {}", bootstrap.block) : "residuals one by one";
}

}  // namespace

Json bootstrap_json(const estimator::Bootstrap& bootstrap) {
    Json out;
    out["kind"] = estimator::name(bootstrap.kind);
    out["block"] = bootstrap.block;
    out["replicates"] = bootstrap.replicates.size();
    out["failed"] = bootstrap.failed;
    out["most_failed_share"] = estimator::most_failed_replicates;
    out["failures"] = json_list(bootstrap.failures, [](const auto& one) -> Json {
        return {{"status", estimator::name(one.status)}, {"count", one.count}, {"message", one.message}};
    });
    out["refused"] = json_or_null(bootstrap.refused);
    out["evaluations"] = bootstrap.evaluations;
    out["parameters"] = quantities_json(bootstrap.parameters);
    out["derived"] = quantities_json(bootstrap.derived);
    out["errors"] = quantities_json(bootstrap.errors);
    out["file"] = "bootstrap.csv";
    return out;
}

std::string replicates_text(const estimator::Bootstrap& bootstrap) {
    fmt::memory_buffer out;
    fmt::format_to(std::back_inserter(out), "replicate,status");
    const auto all = all_quantities(bootstrap);
    for (const auto* x : all)
        fmt::format_to(std::back_inserter(out), ",{0},{1}", csv_cell(x->name), csv_cell("sd(" + x->name + ")"));
    fmt::format_to(std::back_inserter(out), "\n");
    const auto cell = [&](double value) {
        if (std::isfinite(value))
            fmt::format_to(std::back_inserter(out), ",{}", value);
        else
            fmt::format_to(std::back_inserter(out), ",");
    };
    for (const estimator::BootstrapReplicate& replicate : bootstrap.replicates) {
        fmt::format_to(std::back_inserter(out), "{},{}", replicate.number + 1, estimator::name(replicate.status));
        for (std::size_t i = 0; i < all.size(); ++i) {
            const auto place = static_cast<Eigen::Index>(i);
            cell(place < replicate.values.size() ? replicate.values[place] : std::nan(""));
            cell(place < replicate.sds.size() ? replicate.sds[place] : std::nan(""));
        }
        fmt::format_to(std::back_inserter(out), "\n");
    }
    return fmt::to_string(out);
}

std::string bootstrap_summary(const estimator::Bootstrap& bootstrap) {
    SummaryTable table({left_aligned("name"), left_aligned("unit"), "sd by curvature", "by simulation", "bias in sds",
                        left_aligned("percentile 95 %"), left_aligned("studentised 95 %"), left_aligned("")});
    for (const auto* x : all_quantities(bootstrap)) {
        const double bias = x->bias / x->bootstrap_sd;
        table.add(
            {x->name, x->unit, significant(x->sd, 3), significant(x->bootstrap_sd, 3),
             std::isfinite(bias) ? fmt::format("{:+.2f} \u00b1 {:.2f}", bias, x->bias_error / x->bootstrap_sd) : "",
             interval_text(x->percentile_lower, x->percentile_upper, x->bootstrap_sd),
             interval_text(x->studentised_lower, x->studentised_upper, x->bootstrap_sd), x->remark});
    }
    std::string out = table.text();
    out += fmt::format("  {} records drawn anew: {}; {} failed\n", bootstrap.replicates.size(), drawn_from(bootstrap),
                       bootstrap.failed);
    for (const auto& failure : bootstrap.failures)
        out += fmt::format("  {} {}: {}\n", failure.count, estimator::name(failure.status), failure.message);
    if (!bootstrap.refused.empty()) out += fmt::format("  No intervals: {}.\n", bootstrap.refused);
    return out;
}

}  // namespace orbid::apps
