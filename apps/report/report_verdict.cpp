#include <algorithm>
#include <array>
#include <cmath>

#include <fmt/format.h>

#include "apps/drawing/markup_text.hpp"
#include "apps/report/html_text.hpp"
#include "apps/report/report_chapter.hpp"
#include "apps/results/summary_table.hpp"

namespace orbid::apps {

namespace {

using namespace detail;

/// A sentence about how far to trust the result, with its weight.
struct Remark {
    enum class Weight { good, caution, bad };
    Weight weight;
    std::string text;
};

using Remarks = std::vector<Remark>;

/// How weights are called, and how they look: by Remark::Weight.
constexpr std::array<std::string_view, 3> weight_words{"Good", "Caution", "Not usable"};
constexpr std::array<std::string_view, 3> weight_looks{"good", "caution", "bad"};

/// "l, k2 and k3"
std::string listed(const std::vector<std::string>& names) {
    std::string out;
    for (std::size_t i = 0; i < names.size(); ++i)
        out += (i == 0 ? "" : i + 1 == names.size() ? " and " : ", ") + names[i];
    return out;
}

std::string what_was_done(const StoredRun& run) {
    const std::string model = run.job.contains("model") ? text_at(run.job["model"], "name") : std::string();
    std::string out;
    if (run.result) {
        const Json& result = *run.result;
        std::vector<std::string> names;
        if (const Json* parameters = filled(result, "parameters")) {
            for (const auto& [name, entry] : parameters->items())
                names.push_back(name);
        }
        constexpr std::size_t most_names = 8;
        out = names.empty()       ? fmt::format("No parameter of {} was free; errors and states were", model)
              : names.size() == 1 ? fmt::format("{} of {} was", names[0], model)
              : names.size() <= most_names
                  ? fmt::format("{} of {} were", listed(names), model)
                  : fmt::format("{} of {} were", grouped_count(names.size(), "parameter"), model);
        out += " estimated";
        std::vector<std::string> from;
        if (const Json* counts = filled(result, "residuals")) {
            for (const Json& count : *counts) {
                const double used = number_at(count, "used");
                const std::string type = text_at(count, "type");
                if (!(used > 0.0)) continue;
                const auto n = static_cast<std::size_t>(used);
                from.push_back(type == "cycles"   ? grouped_count(n, "unstable periodic orbit")
                               : type == "series" ? grouped_count(n, "interval") + " of the record"
                                                  : fmt::format("{} ({})", grouped_count(n, "record"), type));
            }
        }
        if (!from.empty()) out += " from " + listed(from);
        if (const Json* data = filled(result, "data")) {
            const auto points = static_cast<std::size_t>(std::max(0.0, number_at(*data, "points")));
            const auto segments = static_cast<std::size_t>(std::max(0.0, number_at(*data, "segments")));
            if (points > 0)
                out +=
                    fmt::format("; data: {} in {}", grouped_count(points, "point"), grouped_count(segments, "segment"));
        }
        return out + ".";
    }
    if (run.branch && filled(*run.branch, "branches") != nullptr)
        return fmt::format("{} of periodic orbits of {} followed over {}.",
                           grouped_count(run.branch->at("branches").size(), "branch") == "1 branch"
                               ? std::string("One branch")
                               : fmt::format("{} branches", run.branch->at("branches").size()),
                           model, text_at(run.branch->at("parameter"), "name"));
    if (run.orbits)
        return fmt::format("Periodic orbits of {} were computed: {}.", model,
                           detail::grouped(run.orbits->at("cycles").size()));
    if (run.cycles)
        return fmt::format("The record of {} was searched for unstable periodic orbits: {} found.", model,
                           grouped_count(run.cycles->at("cycles").size(), "cycle"));
    return fmt::format("Data of {} were made.", model);
}

void add_status(const Json& result, Remarks& remarks) {
    const std::string status = text_at(result, "status");
    const std::string message = text_at(result, "message");
    const std::string why = message.empty() ? "" : ": " + message;
    if (status == "converged")
        remarks.push_back({Remark::Weight::good, "The estimate converged" + why + "."});
    else if (status == "interrupted")
        remarks.push_back({Remark::Weight::caution,
                           "The estimate was interrupted; these are the best values until then" + why + "."});
    else if (status == "singular")
        remarks.push_back({Remark::Weight::caution, "The data do not determine all parameters" + why + "."});
    else
        remarks.push_back(
            {Remark::Weight::bad, fmt::format("The estimate did not converge (status {}){}.", status, why)});
}

void add_directions(const Json& result, Remarks& remarks) {
    const Json* identifiability = filled(result, "identifiability");
    if (identifiability == nullptr) return;
    const Json* directions = filled(*identifiability, "null_directions");
    if (directions != nullptr) {
        for (const Json& direction : *directions) {
            std::vector<std::string> names;
            for (const auto& [name, component] : direction.items())
                names.push_back(name);
            remarks.push_back({Remark::Weight::caution,
                               names.size() == 1
                                   ? fmt::format("{} has no effect on the data.", listed(names))
                                   : fmt::format("The data do not tell {} apart: only combinations of them are known.",
                                                 listed(names))});
        }
    } else if (filled(result, "parameters") != nullptr) {
        remarks.push_back({Remark::Weight::good, "The data determine every parameter that was estimated."});
    }
    if (identifiability->contains("trust_normal") && (*identifiability)["trust_normal"] == false) {
        const std::string why = text_at(*identifiability, "distrust");
        remarks.push_back({Remark::Weight::caution,
                           fmt::format("The normal approximation of the posterior is doubtful{}{}: take standard "
                                       "deviations and intervals as orders of size.",
                                       why.empty() ? "" : ": ", why)});
    }
}

void add_parameters(const Json& result, Remarks& remarks) {
    const Json* parameters = filled(result, "parameters");
    if (parameters == nullptr) return;
    std::vector<std::string> by_prior;
    double worst = 0.0;
    std::string worst_name;
    std::size_t known = 0;
    for (const char* list : {"parameters", "derived"}) {
        const Json* entries = filled(result, list);
        if (entries == nullptr) continue;
        for (const auto& [name, entry] : entries->items()) {
            const std::string bound = text_at(entry, "at_bound");
            if (!bound.empty())
                remarks.push_back(
                    {Remark::Weight::caution,
                     fmt::format("{} lies at its {} bound; other uncertainties hold for it held there.", name, bound)});
            // Less than half of the information from the data: the prior says more.
            if (number_at(entry, "data_share") < 0.5) by_prior.push_back(name);
            const double sd = number_at(entry, "sd");
            const double deviates = (number_at(entry, "value") - number_at(entry, "reference")) / sd;
            if (!std::isfinite(deviates)) continue;
            ++known;
            if (std::abs(deviates) >= worst) {
                worst = std::abs(deviates);
                worst_name = name;
            }
        }
    }
    if (!by_prior.empty())
        remarks.push_back(
            {Remark::Weight::caution, fmt::format("Of {} the prior says more than the data.", listed(by_prior))});
    if (known > 0)
        remarks.push_back({worst > 3.0 ? Remark::Weight::caution : Remark::Weight::good,
                           fmt::format("Against {}, the largest deviation is {:.2g} standard deviations ({}).",
                                       grouped_count(known, "known value"), worst, worst_name)});
}

void add_errors(const Json& result, Remarks& remarks) {
    if (const Json* errors = filled(result, "errors")) {
        for (const auto& [group, entry] : errors->items()) {
            const double count = number_at(entry, "count");
            const double worth = number_at(entry, "effective_count");
            if (std::isfinite(number_at(entry, "lag1")) && worth < 0.5 * count)
                remarks.push_back(
                    {Remark::Weight::caution,
                     fmt::format("Residuals of {} follow each other: {:.0f} records are worth about {:.0f}. The model "
                                 "misses something.",
                                 group, count, worth)});
        }
    }
    if (const Json* predictions = filled(result, "prediction")) {
        double worst = 0.0;
        for (const Json& entry : *predictions)
            if (!entry.value("fitted", false)) worst = std::fmax(worst, number_at(entry, "normalised_rms"));
        // Twice the error: what the error scale explains is less than what is left.
        if (worst > 2.0)
            remarks.push_back({Remark::Weight::caution,
                               fmt::format("Data that took no part in the fit are predicted to {:.2g} times their "
                                           "error only.",
                                           worst)});
    }
    if (const Json* posterior = filled(result, "posterior")) {
        if (posterior->contains("trusted")) {
            const bool trusted = (*posterior)["trusted"] == true;
            remarks.push_back(
                {trusted ? Remark::Weight::good : Remark::Weight::caution,
                 trusted ? std::string("Draws from the posterior: the chains agree.")
                         : "Draws from the posterior cannot be trusted: " + text_at(*posterior, "distrust") + "."});
        }
    }
    if (const Json* criticism = filled(result, "criticism")) {
        const double large = number_at(*criticism, "large_defects");
        if (large > 0.0)
            remarks.push_back({Remark::Weight::caution,
                               fmt::format("The model does not carry {:.0f} of {:.0f} intervals of the record.", large,
                                           number_at(*criticism, "intervals"))});
        if (const Json* alternatives = filled(*criticism, "alternatives")) {
            for (const Json& alternative : *alternatives) {
                const Json* factor = filled(alternative, "ln_bayes_factor");
                if (factor != nullptr && number_at(*factor, "value") < -1.0)
                    remarks.push_back({Remark::Weight::caution, fmt::format("The data speak for another model: {}.",
                                                                            text_at(alternative, "model"))});
            }
        }
    }
}

void add_search(const StoredRun& run, Remarks& remarks) {
    const Json* missing = run.cycles ? filled(*run.cycles, "missing") : nullptr;
    if (missing == nullptr) return;
    std::vector<std::string> periods;
    for (const Json& period : *missing)
        periods.push_back(period.dump());
    remarks.push_back({Remark::Weight::caution, fmt::format("No cycle was found of period {}.", listed(periods))});
}

}  // namespace

std::string verdict_html(const ReportSource& source) {
    Remarks remarks;
    if (source.run.result) {
        const Json& result = *source.run.result;
        add_status(result, remarks);
        add_directions(result, remarks);
        add_parameters(result, remarks);
        add_errors(result, remarks);
    }
    add_search(source.run, remarks);
    // What stands in the way first.
    std::stable_sort(remarks.begin(), remarks.end(),
                     [](const Remark& a, const Remark& b) { return a.weight > b.weight; });
    std::string out = "<section class=\"verdict\" aria-labelledby=\"verdict\">\n<h2 id=\"verdict\">In short</h2>\n";
    out += html_paragraph(what_was_done(source.run));
    if (!remarks.empty()) {
        out += "<ul>\n";
        for (const Remark& remark : remarks) {
            const auto weight = static_cast<std::size_t>(remark.weight);
            out += fmt::format("<li class=\"{}\"><strong>{}</strong> <span>{}</span></li>\n", weight_looks[weight],
                               weight_words[weight], markup_text(remark.text));
        }
        out += "</ul>\n";
    }
    return out + "</section>\n";
}

}  // namespace orbid::apps
