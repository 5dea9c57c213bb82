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
    SummaryTable table(
        {left_aligned("experiment"), left_aligned("kind"), left_aligned("from"), left_aligned("SHA-256 of the file")});
    for (const Json* experiment : run.experiments()) {
        const bool simulated = experiment->contains("simulate");
        std::string kind = text_at(*experiment, "kind");
        if (simulated) {
            const Json& simulate = experiment->at("simulate");
            kind = simulate.contains("sections") ? "simulated section" : "simulated samples";
        }
        table.add({text_at(*experiment, "name"), kind, simulated ? "the model" : text_at(*experiment, "file"),
                   text_at(*experiment, "sha256")});
        if (const Json& inputs = block_at(*experiment, "inputs"); !inputs.empty())
            table.add({text_at(*experiment, "name"), "inputs", text_at(inputs, "file"), text_at(inputs, "sha256")});
    }
    return html_table("Data", table);
}

std::string origin_table(const StoredRun& run) {
    SummaryTable table({left_aligned("part"), left_aligned("version or value")});
    for (const auto& [name, version] : block_at(run.job, "versions").items())
        table.add({name, plain(version)});
    if (run.job.contains("seed")) table.add({"seed", plain(run.job["seed"])});
    const auto add = [&table](const char* name, const std::optional<Json>& file) {
        if (const Json& fingerprint = block_at(file, "fingerprint"); !fingerprint.empty())
            table.add({fmt::format("fingerprint of {}", name), text_at(fingerprint, "sha256")});
    };
    add("cycles.json", run.cycles);
    add("orbits.json", run.orbits);
    add("branch.json", run.branch);
    add("estimate_branch.json", run.estimate_branch);
    add("result.json", run.result);
    return html_table("Made by", table);
}

std::string times_table(const Json& timing) {
    SummaryTable table({left_aligned("stage"), "seconds", left_aligned("remark")});
    for (const Json& stage : block_at(timing, "stages"))
        table.add({text_at(stage, "stage"), number_cell(number_at(stage, "seconds"), 3),
                   stage.value("reused", false) ? "taken from an earlier run" : ""});
    table.add({"all", number_cell(number_at(timing, "seconds"), 3), ""});
    return html_table(fmt::format("Times, with {} threads", significant(number_at(timing, "threads"), 6)), table);
}

std::string captured_table(const Json& result) {
    SummaryTable table({left_aligned("experiment"), "trajectory", "after point", left_aligned("what")});
    for (const Json& entry : block_at(block_at(result, "data"), "captured"))
        table.add({text_at(entry, "experiment"), significant(number_at(entry, "trajectory"), 9),
                   significant(number_at(entry, "section"), 12), text_at(entry, "what")});
    return html_table("Simulated trajectories that left the chaos", table);
}

std::string model_table(const Json& job) {
    const Json& model = block_at(job, "model");
    const Json& free = block_at(block_at(job, "estimate"), "parameters");
    const std::string variant = text_at(model, "variant");
    SummaryTable table({left_aligned("parameter"), "value", left_aligned("in this run")});
    for (const auto& [name, value] : block_at(model, "parameters").items())
        table.add({name, plain(value), free.contains(name) ? "estimated" : ""});
    return html_table(fmt::format("Model {}{}{}: values of the job", text_at(model, "name"),
                                  variant.empty() ? "" : ", variant ", variant),
                      table);
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
