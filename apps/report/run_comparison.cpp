#include "apps/report/run_comparison.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>
#include <vector>

#include <fmt/format.h>

#include "apps/report/plots/cycle_pairing.hpp"
#include "apps/report/plots/json_member.hpp"
#include "apps/results/strategy_results.hpp"
#include "apps/results/summary_table.hpp"

namespace orbid::apps {

namespace {

using Json = StoredRun::Json;
using Align = SummaryTable::Align;
using detail::number_at;

const Json& block(const StoredRun& run, const char* name) {
    return detail::block_at(run.result, name);
}

std::string text_at(const Json& object, const char* pointer) {
    const auto at = Json::json_pointer(pointer);
    if (!object.contains(at)) return {};
    const Json& value = object.at(at);
    return value.is_string() ? value.get<std::string>() : value.is_null() ? std::string() : value.dump();
}

std::string model_name(const StoredRun& run) {
    const std::string name = text_at(run.job, "/model/name");
    const std::string variant = text_at(run.job, "/model/variant");
    if (name.empty()) return "equations of the job";
    return variant.empty() ? name : name + ", " + variant;
}

std::string with_sd(const Json& entry) {
    const double sd = number_at(entry, "sd");
    std::string words = with_digits_of(number_at(entry, "value"), sd);
    return std::isfinite(sd) && sd > 0.0 ? words + " ± " + significant(sd, 2) : words;
}

std::string head_table(const StoredRun& first, const StoredRun& second) {
    SummaryTable table({{"", Align::left}, {"first", Align::left}, {"second", Align::left}});
    const auto add = [&](const std::string& name, const std::string& a, const std::string& b) {
        if (!a.empty() || !b.empty()) table.add({name, a, b});
    };
    add("folder", first.folder.string(), second.folder.string());
    add("title", first.title(), second.title());
    add("model", model_name(first), model_name(second));
    const Json a = first.result.value_or(Json::object());
    const Json b = second.result.value_or(Json::object());
    add("status", text_at(a, "/status"), text_at(b, "/status"));
    add("points", text_at(a, "/data/points"), text_at(b, "/data/points"));
    add("degrees of freedom", significant(number_at(a, "degrees_of_freedom"), 6),
        significant(number_at(b, "degrees_of_freedom"), 6));
    return table.text();
}

struct Difference {
    std::string table;
    std::size_t common = 0;
    double largest = 0.0;  ///< in sds
};

Difference quantities_table(const StoredRun& first, const StoredRun& second) {
    Difference out;
    SummaryTable table({{"", Align::left},
                        {"first", Align::left},
                        {"second", Align::left},
                        {"difference"},
                        {"in sds"},
                        {"unit", Align::left}});
    for (const char* name : {"parameters", "derived"}) {
        const Json& theirs = block(second, name);
        for (const auto& [quantity, entry] : block(first, name).items()) {
            if (!theirs.contains(quantity)) continue;
            const Json& other = theirs[quantity];
            ++out.common;
            const double difference = number_at(other, "value") - number_at(entry, "value");
            const double sd = std::hypot(number_at(entry, "sd"), number_at(other, "sd"));
            const double sds = sd > 0.0 ? difference / sd : std::numeric_limits<double>::quiet_NaN();
            if (std::isfinite(sds)) out.largest = std::max(out.largest, std::abs(sds));
            const std::string unit = entry.value("unit", std::string());
            table.add({quantity, with_sd(entry), with_sd(other), significant(difference, 3),
                       std::isfinite(sds) ? fmt::format("{:+.2f}", sds) : std::string(), unit == "1" ? "" : unit});
        }
    }
    out.table = table.text();
    return out;
}

/// Quantities that one of the two has alone.
std::string only_in(const StoredRun& run, const StoredRun& other) {
    std::string names;
    for (const char* name : {"parameters", "derived"}) {
        for (const auto& entry : block(run, name).items())
            if (!block(other, name).contains(entry.key())) names += (names.empty() ? "" : ", ") + entry.key();
    }
    return names;
}

std::string scales_table(const StoredRun& first, const StoredRun& second) {
    SummaryTable table({{"", Align::left}, {"first"}, {"second"}, {"ratio"}, {"unit", Align::left}});
    const Json& theirs = block(second, "errors");
    for (const auto& [group, entry] : block(first, "errors").items()) {
        if (!theirs.contains(group)) continue;
        const double a = number_at(entry, "sd");
        const double b = number_at(theirs[group], "sd");
        const std::string unit = entry.value("unit", std::string());
        table.add({group, significant(a, 4), significant(b, 4), significant(b / a, 3), unit == "1" ? "" : unit});
    }
    return table.text();
}

/// What makes a record: its file by content, or how it was simulated.
std::string origin_of(const StoredRun& run, const Json& experiment) {
    if (experiment.contains("sha256")) return experiment["sha256"].dump();
    if (!experiment.contains("simulate")) return {};
    Json made = experiment.value("simulate", Json());
    made["model"] = run.job.value("model", Json());
    made["seed"] = run.job.value("seed", Json());
    made["sensor"] = experiment.value("sensor", Json());
    made["own"] = experiment.value("parameters", Json());
    return made.dump();
}

/// 0: none of the records is in both, 1: some, 2: all of both.
int shared_data(const StoredRun& first, const StoredRun& second) {
    std::set<std::string> a;
    std::set<std::string> b;
    for (const Json* one : first.experiments())
        a.insert(origin_of(first, *one));
    for (const Json* one : second.experiments())
        b.insert(origin_of(second, *one));
    a.erase("");
    b.erase("");
    if (a.empty() || b.empty()) return 0;
    if (a == b) return 2;
    return std::any_of(a.begin(), a.end(), [&](const std::string& one) { return b.contains(one); }) ? 1 : 0;
}

/// The same residuals of the same records: objectives and evidences may be compared.
bool same_residuals(const StoredRun& first, const StoredRun& second) {
    const auto pointer = Json::json_pointer("/estimate/residuals");
    if (shared_data(first, second) != 2 || !first.job.contains(pointer) || !second.job.contains(pointer)) return false;
    const auto kinds = [&](const StoredRun& run) {
        std::vector<std::string> list;
        for (const Json& residual : run.job.at(pointer))
            list.push_back(residual.value("type", Json()).dump() + residual.value("data", Json()).dump() +
                           residual.value("periods", Json()).dump() + residual.value("positions", Json()).dump() +
                           residual.value("multipliers", Json()).dump());
        return list;
    };
    const auto records = [](const StoredRun& run) {
        std::vector<std::string> list;
        for (const auto& entry : block(run, "errors").items())
            list.push_back(entry.key() + entry.value().value("count", Json()).dump());
        std::sort(list.begin(), list.end());
        return list;
    };
    return kinds(first) == kinds(second) && records(first) == records(second);
}

std::string evidence_words(const StoredRun& first, const StoredRun& second) {
    if (!first.result || !second.result || !same_residuals(first, second)) return {};
    const double objective = number_at(*second.result, "objective") - number_at(*first.result, "objective");
    std::string out;
    if (std::isfinite(objective))
        out += fmt::format("  objective of the second less that of the first: {}\n", significant(objective, 5));
    const double bayes =
        number_at(block(first, "log_evidence"), "value") - number_at(block(second, "log_evidence"), "value");
    if (!std::isfinite(bayes)) return out;
    std::string words = in_words(bayes);
    for (const auto& [from, to] : {std::pair{"the job's model", "the first"}, std::pair{"this one", "the second"}}) {
        const auto at = words.find(from);
        if (at != std::string::npos) words.replace(at, std::string_view(from).size(), to);
    }
    return out +
           fmt::format("  ln Bayes factor of the first against the second: {}; {}\n", significant(bayes, 5), words);
}

/// Every place where two JSON values differ.
void differences(const Json& a, const Json& b, const std::string& pointer, SummaryTable& table, std::size_t& count) {
    constexpr std::size_t most = 40;
    if (a == b || count >= most) return;
    const auto shown = [](const Json* value) {
        constexpr std::size_t longest = 48;
        std::string text = value == nullptr ? "–" : value->dump();
        return shown_width(text) <= longest ? text : text.substr(0, longest - 3) + "...";
    };
    const auto leaf = [&](const std::string& at, const Json* one, const Json* other) {
        if (count++ < most) table.add({at, shown(one), shown(other)});
    };
    if (a.is_object() && b.is_object()) {
        for (const auto& [key, value] : a.items()) {
            if (b.contains(key)) {
                differences(value, b[key], pointer + "/" + key, table, count);
            } else {
                leaf(pointer + "/" + key, &value, nullptr);
            }
        }
        for (const auto& [key, value] : b.items())
            if (!a.contains(key)) leaf(pointer + "/" + key, nullptr, &value);
        return;
    }
    if (a.is_array() && b.is_array() && a.size() == b.size()) {
        for (std::size_t i = 0; i < a.size(); ++i)
            differences(a.at(i), b.at(i), pointer + "/" + std::to_string(i), table, count);
        return;
    }
    leaf(pointer, &a, &b);
}

std::string jobs_table(const StoredRun& first, const StoredRun& second) {
    SummaryTable table({{"", Align::left}, {"first", Align::left}, {"second", Align::left}});
    Json a = first.job;
    Json b = second.job;
    for (Json* job : {&a, &b}) {
        job->erase("versions");
        job->erase("title");
    }
    std::size_t count = 0;
    differences(a, b, "", table, count);
    return table.text();
}

std::string holdings(const StoredRun& run) {
    std::string text;
    const auto add = [&text](bool there, std::string_view what) {
        if (there) text += (text.empty() ? "" : ", ") + std::string(what);
    };
    add(run.result.has_value(), "an estimate");
    add(run.cycles.has_value(), "measured cycles");
    add(run.orbits.has_value(), "computed orbits");
    add(run.branch.has_value(), "branches");
    return fmt::format("{}: {}, with {}", run.folder.string(), model_name(run), text.empty() ? "no results" : text);
}

}  // namespace

std::string comparison_text(const StoredRun& first, const StoredRun& second) {
    const Difference quantities = quantities_table(first, second);
    MatchedCycles cycles;
    MatchedCycles orbits;
    if (first.cycles && second.cycles) cycles = matched_cycles(first, *first.cycles, *second.cycles);
    if (!cycles.common && first.orbits && second.orbits) orbits = matched_cycles(first, *first.orbits, *second.orbits);
    const bool same_model = model_name(first) == model_name(second);
    if (quantities.common == 0 && cycles.common == 0 && orbits.common == 0)
        throw StoredRunRefused(fmt::format(
            "nothing to compare: no parameter, derived quantity or periodic orbit that both have\n  {}\n  {}",
            holdings(first), holdings(second)));
    std::string out = head_table(first, second);
    out += titled("Estimates", quantities.table);
    for (const auto& [words, names] :
         {std::pair{"first", only_in(first, second)}, {"second", only_in(second, first)}}) {
        if (!names.empty()) out += fmt::format("  only in the {}: {}\n", words, names);
    }
    out += titled("Error scales", scales_table(first, second));
    out += titled("Evidence", evidence_words(first, second));
    out += titled("Measured cycles", cycles.table);
    out += titled("Computed orbits", orbits.table);
    out += titled("Jobs differ in", jobs_table(first, second));
    std::string remarks;
    const int shared = shared_data(first, second);
    if (quantities.common > 0 && shared > 0) {
        remarks += fmt::format(
            "  both rest on {}the same data: their errors are correlated, and differences are larger in true sds than "
            "shown\n",
            shared == 1 ? "partly " : "");
    } else if (quantities.largest > 3.0) {
        remarks +=
            fmt::format("  the largest difference is {:.1f} sds: the two disagree by more than their errors explain\n",
                        quantities.largest);
    }
    if (!same_model) remarks += "  the models differ: parameters of one name need not mean the same\n";
    return out + titled("Remarks", remarks);
}

}  // namespace orbid::apps
