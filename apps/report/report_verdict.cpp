#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "apps/report/report_chapter.hpp"
#include "apps/results/lost_records.hpp"
#include "apps/results/summary_table.hpp"

namespace orbid::apps {

namespace {

using namespace detail;

/// "l, k2 and k3"
std::string listed(const std::vector<std::string>& names) {
    std::string out;
    for (std::size_t i = 0; i < names.size(); ++i)
        out += (i == 0 ? "" : i + 1 == names.size() ? " and " : ", ") + names[i];
    return out;
}

std::string what_was_done(const StoredRun& run) {
    const std::string model = text_at(block_at(run.job, "model"), "name");
    std::string out;
    if (run.result) {
        const Json& result = *run.result;
        std::vector<std::string> names;
        for (const auto& [name, entry] : block_at(result, "parameters").items())
            names.push_back(name);
        constexpr std::size_t most_names = 8;
        out = names.empty()       ? fmt::format("No parameter of {} was free; errors and states were", model)
              : names.size() == 1 ? fmt::format("{} of {} was", names[0], model)
              : names.size() <= most_names
                  ? fmt::format("{} of {} were", listed(names), model)
                  : fmt::format("{} of {} were", grouped_count(names.size(), "parameter"), model);
        out += " estimated";
        std::vector<std::string> from;
        for (const Json& count : block_at(result, "residuals")) {
            const double used = number_at(count, "used");
            const std::string type = text_at(count, "type");
            if (!(used > 0.0)) continue;
            const auto n = static_cast<std::size_t>(used);
            from.push_back(type == "cycles"   ? grouped_count(n, "unstable periodic orbit")
                           : type == "series" ? grouped_count(n, "interval") + " of the record"
                                              : fmt::format("{} ({})", grouped_count(n, "record"), type));
        }
        if (!from.empty()) out += " from " + listed(from);
        const Json& data = block_at(result, "data");
        const auto points = static_cast<std::size_t>(std::max(0.0, number_at(data, "points")));
        const auto segments = static_cast<std::size_t>(std::max(0.0, number_at(data, "segments")));
        if (points > 0)
            out += fmt::format("; data: {} in {}", grouped_count(points, "point"), grouped_count(segments, "segment"));
        return out + ".";
    }
    if (const std::size_t branches = block_at(run.branch, "branches").size(); branches > 0)
        return fmt::format("{} of periodic orbits of {} followed over {}.",
                           branches == 1 ? std::string("One branch") : fmt::format("{} branches", branches), model,
                           text_at(run.branch->at("parameter"), "name"));
    if (run.orbits)
        return fmt::format("Periodic orbits of {} were computed: {}.", model,
                           detail::grouped(run.orbits->at("cycles").size()));
    if (run.cycles)
        return fmt::format("The record of {} was searched for unstable periodic orbits: {} found.", model,
                           grouped_count(run.cycles->at("cycles").size(), "cycle"));
    return fmt::format("Data of {} were made.", model);
}

/// The one line that everything else explains; its look is that of the verdict.
void add_trust(const Json& result, ReportRemarks& remarks) {
    const Json& verdict = block_at(result, "verdict");
    const std::string trust = text_at(verdict, "trust");
    const std::string line = text_at(verdict, "line");
    if (trust == "all")
        remarks.good("Verdict: trust. Values and intervals hold as far as model and data can tell.");
    else if (trust == "values")
        remarks.caution(fmt::format("Verdict: {}.", line));
    else if (trust == "none")
        remarks.bad(fmt::format("Verdict: {}.", line));
    const Json& because = block_at(verdict, "because");
    for (std::size_t i = 1; i < because.size(); ++i)
        remarks.caution(because.at(i).get<std::string>() + ".");
}

void add_status(const Json& result, ReportRemarks& remarks) {
    const std::string status = text_at(result, "status");
    const std::string message = text_at(result, "message");
    const std::string why = message.empty() ? "" : ": " + message;
    double least = 1.0;  // share of the records that are used
    for (const Json& count : block_at(result, "residuals")) {
        const double used = number_at(count, "used");
        const auto lost = static_cast<double>(block_at(count, "unused").size());
        if (counts_records(text_at(count, "type")) && lost > 0.0) least = std::min(least, used / (used + lost));
    }
    if (status == "converged" && least < least_used_share)
        remarks.bad(fmt::format("The estimate converged on {:.0f} % of the records only{}.", 100.0 * least, why));
    else if (status == "converged" && least < 1.0)
        remarks.caution("The estimate converged without some of the records" + why + ".");
    else if (status == "converged" && text_at(block_at(result, "verdict"), "trust") != "all" &&
             result.contains("verdict"))
        remarks.caution("The estimate converged" + why + ".");
    else if (status == "converged")
        remarks.good("The estimate converged" + why + ".");
    else if (status == "interrupted")
        remarks.caution("The estimate was interrupted; these are the best values until then" + why + ".");
    else if (status == "singular")
        remarks.caution("The data do not determine all parameters" + why + ".");
    else
        remarks.bad(fmt::format("The estimate did not converge (status {}){}.", status, why));
}

void add_directions(const Json& result, ReportRemarks& remarks) {
    const Json& identifiability = block_at(result, "identifiability");
    if (identifiability.empty()) return;
    const Json& directions = block_at(identifiability, "null_directions");
    for (const Json& direction : directions) {
        std::vector<std::string> names;
        for (const auto& [name, component] : direction.items())
            names.push_back(name);
        remarks.caution(
            names.size() == 1
                ? fmt::format("{} has no effect on the data.", listed(names))
                : fmt::format("The data do not tell {} apart: only combinations of them are known.", listed(names)));
    }
    const Json& structural = block_at(identifiability, "structural");
    for (const Json& direction : block_at(structural, "directions"))
        remarks.caution(
            fmt::format("No record can tell: {}. {} was held at its start; the other estimates hold for that "
                        "value.",
                        text_at(direction, "text"), text_at(direction, "held")));
    if (directions.empty() && !block_at(result, "parameters").empty())
        remarks.good("The data determine every parameter that was estimated.");
    if (identifiability.value("trust_normal", Json()) == false) {
        const std::string why = text_at(identifiability, "distrust");
        remarks.caution(
            fmt::format("The normal approximation of the posterior is doubtful{}{}: take standard deviations and "
                        "intervals as orders of size.",
                        why.empty() ? "" : ": ", why));
    }
}

void add_parameters(const Json& result, ReportRemarks& remarks) {
    if (block_at(result, "parameters").empty()) return;
    std::vector<std::string> by_prior, biases;
    double worst = 0.0;
    std::string worst_name;
    std::size_t known = 0;
    for (const char* list : {"parameters", "derived"}) {
        for (const auto& [name, entry] : block_at(result, list).items()) {
            const std::string bound = text_at(entry, "at_bound");
            if (!bound.empty())
                remarks.caution(
                    fmt::format("{} lies at its {} bound; other uncertainties hold for it held there.", name, bound));
            // Less than half of the information from the data: the prior says more.
            if (number_at(entry, "data_share") < 0.5 && !entry.contains("held")) by_prior.push_back(name);
            const double sd = number_at(entry, "sd");
            if (const double bias = number_at(entry, "bias"); std::abs(bias) > 0.0)
                biases.push_back(fmt::format("{} {:+.2f}", name, bias / sd));
            const double deviates = (number_at(entry, "value") - number_at(entry, "reference")) / sd;
            if (!std::isfinite(deviates)) continue;
            ++known;
            if (std::abs(deviates) >= worst) {
                worst = std::abs(deviates);
                worst_name = name;
            }
        }
    }
    if (!by_prior.empty()) remarks.caution(fmt::format("Of {} the prior says more than the data.", listed(by_prior)));
    if (!biases.empty())
        remarks.good(fmt::format("The bias that errors of readings give by the course was taken off: {} sds.",
                                 fmt::join(biases, ", ")));
    if (known == 0) return;
    const std::string words = fmt::format("Against {}, the largest deviation is {:.2g} standard deviations ({}).",
                                          grouped_count(known, "known value"), worst, worst_name);
    worst > 3.0 ? remarks.caution(words) : remarks.good(words);
}

void add_errors(const Json& result, ReportRemarks& remarks) {
    const std::string verdict = text_at(block_at(result, "verdict"), "line");
    for (const auto& [group, entry] : block_at(result, "errors").items()) {
        const double count = number_at(entry, "count");
        const double worth = number_at(entry, "effective_count");
        const bool told = verdict.find(fmt::format("residuals of {} follow each other", group)) != std::string::npos;
        if (!told && std::isfinite(number_at(entry, "lag1")) && worth < 0.5 * count)
            remarks.caution(
                fmt::format("Residuals of {} follow each other: {:.0f} records are worth about {:.0f}. The model "
                            "misses something.",
                            group, count, worth));
    }
    double worst = 0.0;
    for (const Json& entry : block_at(result, "prediction"))
        if (!entry.value("fitted", false)) worst = std::fmax(worst, number_at(entry, "normalised_rms"));
    // Twice the error: what the error scale explains is less than what is left.
    if (worst > 2.0)
        remarks.caution(
            fmt::format("Data that took no part in the fit are predicted to {:.2g} times their error only.", worst));
    const Json& posterior = block_at(result, "posterior");
    if (posterior.value("trusted", Json()) == true)
        remarks.good("Draws from the posterior: the chains agree.");
    else if (posterior.contains("trusted"))
        remarks.caution("Draws from the posterior cannot be trusted: " + text_at(posterior, "distrust") + ".");
    const Json& criticism = block_at(result, "criticism");
    if (const double large = number_at(criticism, "large_defects"); large > 0.0)
        remarks.caution(fmt::format("The model does not carry {:.0f} of {:.0f} intervals of the record.", large,
                                    number_at(criticism, "intervals")));
    for (const Json& alternative : block_at(criticism, "alternatives"))
        if (number_at(block_at(alternative, "ln_bayes_factor"), "value") < -1.0)
            remarks.caution(fmt::format("The data speak for another model: {}.", text_at(alternative, "model")));
}

void add_search(const StoredRun& run, ReportRemarks& remarks) {
    std::vector<std::string> periods;
    for (const Json& period : block_at(run.cycles, "missing"))
        periods.push_back(period.dump());
    if (!periods.empty()) remarks.caution(fmt::format("No cycle was found of period {}.", listed(periods)));
}

}  // namespace

std::string verdict_html(const ReportSource& source) {
    ReportRemarks remarks;
    if (source.run.result) {
        const Json& result = *source.run.result;
        add_trust(result, remarks);
        add_status(result, remarks);
        add_directions(result, remarks);
        add_parameters(result, remarks);
        add_errors(result, remarks);
    }
    add_search(source.run, remarks);
    // Good news beside a result that is not to be trusted would mislead.
    const bool usable = !source.run.result || text_at(block_at(*source.run.result, "verdict"), "trust") != "none";
    return verdict_section(what_was_done(source.run), usable ? remarks.html() : remarks.html_of_faults());
}

}  // namespace orbid::apps
