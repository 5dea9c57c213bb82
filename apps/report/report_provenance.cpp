#include <cmath>

#include <fmt/format.h>

#include "apps/documents/json_text.hpp"
#include "apps/drawing/markup_text.hpp"
#include "apps/report/html_text.hpp"
#include "apps/report/report_chapter.hpp"
#include "apps/results/summary_table.hpp"

namespace orbid::apps {

namespace {

using namespace detail;

std::string plain(const Json& value) {
    return value.is_string() ? value.get<std::string>() : value.dump();
}

std::string data_table(const StoredRun& run) {
    HtmlTable table("Data", {{"experiment", false}, {"kind", false}, {"from", false}, {"SHA-256 of the file", false}});
    for (const Json* experiment : run.experiments()) {
        const bool simulated = experiment->contains("simulate");
        std::string kind = text_at(*experiment, "kind");
        if (simulated) {
            const Json& simulate = (*experiment)["simulate"];
            kind = simulate.contains("sections") ? "simulated section" : "simulated samples";
        }
        table.add({text_at(*experiment, "name"), kind, simulated ? "the model" : text_at(*experiment, "file"),
                   text_at(*experiment, "sha256")});
        if (const Json* inputs = filled(*experiment, "inputs"))
            table.add({text_at(*experiment, "name"), "inputs", text_at(*inputs, "file"), text_at(*inputs, "sha256")});
    }
    return table.html();
}

std::string origin_table(const StoredRun& run) {
    HtmlTable table("Made by", {{"part", false}, {"version or value", false}});
    if (const Json* versions = filled(run.job, "versions")) {
        for (const auto& [name, version] : versions->items())
            table.add({name, plain(version)});
    }
    if (run.job.contains("seed")) table.add({"seed", plain(run.job["seed"])});
    const auto add = [&table](const char* name, const std::optional<Json>& file) {
        if (!file) return;
        if (const Json* fingerprint = filled(*file, "fingerprint"))
            table.add({fmt::format("fingerprint of {}", name), text_at(*fingerprint, "sha256")});
    };
    add("cycles.json", run.cycles);
    add("orbits.json", run.orbits);
    add("branch.json", run.branch);
    add("result.json", run.result);
    return table.html();
}

std::string times_table(const Json& timing) {
    HtmlTable table(fmt::format("Times, with {} threads", significant(number_at(timing, "threads"), 6)),
                    {{"stage", false}, {"seconds"}, {"remark", false}});
    if (const Json* stages = filled(timing, "stages")) {
        for (const Json& stage : *stages) {
            const double seconds = number_at(stage, "seconds");
            table.add({text_at(stage, "stage"), number_cell(seconds, 3),
                       stage.value("reused", false) ? "taken from an earlier run" : ""});
        }
    }
    const double all = number_at(timing, "seconds");
    table.add({"all", number_cell(all, 3), ""});
    return table.html();
}

std::string captured_table(const Json& result) {
    const Json* data = filled(result, "data");
    const Json* captured = data == nullptr ? nullptr : filled(*data, "captured");
    if (captured == nullptr) return "";
    HtmlTable table("Simulated trajectories that left the chaos",
                    {{"experiment", false}, {"trajectory"}, {"after point"}, {"what", false}});
    for (const Json& entry : *captured)
        table.add({text_at(entry, "experiment"), significant(number_at(entry, "trajectory"), 9),
                   significant(number_at(entry, "section"), 12), text_at(entry, "what")});
    return table.html();
}

std::string model_table(const Json& job) {
    const Json* model = filled(job, "model");
    if (model == nullptr) return "";
    const std::string variant = text_at(*model, "variant");
    HtmlTable table(fmt::format("Model {}{}{}: values of the job", text_at(*model, "name"),
                                variant.empty() ? "" : ", variant ", variant),
                    {{"parameter", false}, {"value"}, {"in this run", false}});
    const Json* estimate = filled(job, "estimate");
    const Json* free = estimate == nullptr ? nullptr : filled(*estimate, "parameters");
    if (const Json* values = filled(*model, "parameters")) {
        for (const auto& [name, value] : values->items())
            table.add({name, plain(value), free != nullptr && free->contains(name) ? "estimated" : ""});
    }
    return table.html();
}

}  // namespace

ReportChapter provenance_chapter(const ReportSource& source) {
    const StoredRun& run = source.run;
    ReportChapter chapter{"provenance", "Where this comes from", ""};
    chapter.html += html_paragraph(
        "The job below, its seed and its data give the same results again: orbid run job.json in this folder repeats "
        "it. Numbers here are rounded; result.json and the other files hold them as computed.");
    chapter.html += model_table(run.job);
    chapter.html += data_table(run);
    if (run.result) chapter.html += captured_table(*run.result);
    chapter.html += origin_table(run);
    if (run.timing) chapter.html += times_table(*run.timing);
    chapter.html += fmt::format("<details><summary>The whole job</summary><pre tabindex=\"0\">{}</pre></details>\n",
                                markup_text(json_text(run.job)));
    return chapter;
}

}  // namespace orbid::apps
