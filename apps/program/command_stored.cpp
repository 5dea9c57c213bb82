#include "apps/program/command_stored.hpp"

#include <algorithm>
#include <charconv>
#include <filesystem>
#include <functional>
#include <ostream>
#include <span>
#include <sstream>

#include <fmt/format.h>

#include "apps/documents/atomic_file.hpp"
#include "apps/documents/printable.hpp"
#include "apps/drawing/chart_picture.hpp"
#include "apps/job/data_job.hpp"
#include "apps/job/periodic_job.hpp"
#include "apps/job/version.hpp"
#include "apps/job/writing/job_writer.hpp"
#include "apps/report/plots/picture_file.hpp"
#include "apps/report/plots/plot_catalog.hpp"
#include "apps/report/plots/run_charts.hpp"
#include "apps/report/report_page.hpp"
#include "apps/report/run_comparison.hpp"
#include "apps/results/summary_table.hpp"
#include "apps/stages/orbits_stage.hpp"
#include "apps/stages/progress.hpp"
#include "apps/stages/recorded_series.hpp"
#include "apps/stages/state_size.hpp"
#include "apps/stored_run/forecast.hpp"
#include "apps/stored_run/motion_results.hpp"
#include "apps/stored_run/prediction_job.hpp"
#include "apps/stored_run/prediction_results.hpp"
#include "apps/stored_run/stored_inputs.hpp"
#include "apps/stored_run/stored_run.hpp"
#include "orbits/records/data_error.hpp"

namespace orbid::apps {

namespace {

/// The value of an option as a number within a range.
double number_of(const CommandCall& call, const std::string& option, double without, double lowest, double highest) {
    if (!call.has(option)) return without;
    const std::string text = call.value(option, "");
    double number = 0.0;
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
    if (error != std::errc() || end != text.data() + text.size())
        throw CommandLineError(fmt::format("--{} must be a number, not \"{}\"", option, text));
    if (!(number >= lowest && number <= highest))
        throw CommandLineError(fmt::format("--{} must be in [{}, {}], not {}", option, lowest, highest, number));
    return number;
}

/// The folder that a prediction is stored in: that of the option, or one in the folder of the run. That may come from
/// somebody else: a link in it would lead out of it.
std::filesystem::path prediction_folder(const CommandCall& call, const StoredRun& run,
                                        const std::filesystem::path& data) {
    const auto own = run.folder / ("predict_" + data.stem().string());
    if (!call.has("out") && std::filesystem::is_symlink(own))
        throw FolderRefused(
            fmt::format("{} is a symbolic link: give the folder for the results by --out", own.string()));
    return call.value("out", own.string());
}

std::string plot_list(const StoredRun& run) {
    SummaryTable table({left_aligned("plot"), left_aligned("shows")});
    for (const AvailablePlot& plot : available_plots(run))
        table.add({plot.name, plot.description});
    if (table.empty()) return fmt::format("{}: nothing to plot\n", run.folder.string());
    return table.text();
}

/// Removes what a killed command left of this file.
void clear_place(const std::filesystem::path& file) {
    remove_leftover_temporaries(file.has_parent_path() ? file.parent_path() : std::filesystem::path("."),
                                file.filename().string());
}

/// What is said of a folder whose files do not hold what this program stores in them.
std::string changed_folder(const std::filesystem::path& folder, const nlohmann::json::exception& error) {
    std::string rule = error.what();
    rule = rule.substr(std::min(rule.find("] ") + 2, rule.size()));
    return fmt::format(
        "{}: a JSON file in this folder does not hold what is stored there ({}); it was changed since: restore it, or "
        "run the job again",
        folder.string(), rule);
}

/// Runs a command on stored files; reports their problems on standard error and then returns 2 or 3.
int with_stored_files(const CommandCall& call, const std::function<int()>& command) {
    const auto refused = [&call](const std::exception& error, int code) {
        call.console.error << error.what() << '\n';
        return code;
    };
    try {
        return command();
    } catch (const nlohmann::json::exception& error) {
        call.console.error << changed_folder(call.words.at(0), error) << '\n';
        return unusable_data;
    } catch (const StoredRunRefused& error) {
        return refused(error, wrong_call);
    } catch (const PictureRefused& error) {
        return refused(error, wrong_call);
    } catch (const FolderRefused& error) {
        return refused(error, wrong_call);
    } catch (const FileUnreadable& error) {
        return refused(error, unusable_data);
    } catch (const orbits::DataError& error) {
        return refused(error, unusable_data);
    }
}

}  // namespace

std::vector<std::string> plot_formats() {
    return {"svg", "pdf", "png"};
}

int plot_run(const CommandCall& call) {
    PlotStyle style;
    style.width_mm = number_of(call, "width", style.width_mm, 41.0, 1000.0);
    style.font_pt = number_of(call, "font", style.font_pt, 4.0, 24.0);
    style.title = call.has("title");
    const double dots = number_of(call, "dpi", 300.0, 20.0, 2400.0);
    return with_stored_files(call, [&] {
        const StoredRun run = read_stored_run(call.words[0]);
        if (call.words.size() < 2) {
            call.console.out << plot_list(run);
            return 0;
        }
        const std::string& name = call.words[1];
        // Without --format the name of the file says it.
        std::string type = "svg";
        const auto formats = plot_formats();
        if (call.has("out")) {
            std::string ending = std::filesystem::path(call.value("out", "")).extension().string();
            if (!ending.empty()) ending.erase(0, 1);
            if (std::find(formats.begin(), formats.end(), ending) != formats.end()) type = ending;
        }
        type = call.value("format", type);
        const auto format =
            static_cast<PictureFormat>(std::find(formats.begin(), formats.end(), type) - formats.begin());
        std::string svg;
        try {
            svg = plot_svg(run, name, style);
        } catch (const std::invalid_argument& error) {
            throw CommandLineError(
                fmt::format("{}; orbid plot {} lists what there is", error.what(), run.folder.string()));
        }
        const std::string out = call.value("out", (run.folder / fmt::format("plot_{}.{}", name, type)).string());
        const std::string bytes = picture_file(svg, format, dots);
        if (out == "-") {
            write_unfiltered(call.console.out, bytes);
        } else {
            clear_place(out);
            write_atomically(out, bytes);
            call.console.out << out << '\n';
        }
        return 0;
    });
}

namespace {

/// Answers a question on periodic motions.
int predict_motions_of(const CommandCall& call, const StoredRun& run, const std::filesystem::path& file) {
    const MotionQuestion question = motion_question(run, file, call.value("experiment", ""));
    if (call.has("inputs"))
        throw CommandLineError("--inputs belongs to a record; a question on periodic motions has none");
    const Job& job = question.job;
    const std::filesystem::path out = prediction_folder(call, run, file);
    const nlohmann::json document = nlohmann::json::parse(job_document(job, out, versions()).dump());
    OutputFolder folder(out, document, job_text(job, out, versions()), call.has("force"));
    Progress progress(call.has("quiet"), call.console.error, call.console.error_terminal);
    const MotionPrediction result =
        predict_motions(run, question, [&](const std::string& what, std::size_t done, std::size_t total) {
            if (done == 0) return progress.begin(what, static_cast<double>(total), "draws");
            progress.at(static_cast<double>(done));
        });
    progress.end();
    folder.store("prediction.json", motion_prediction_text(result));
    if (!result.followed.branches.empty()) {
        const models::Parameter& parameter = job.model.parameter(job.periodic->continuation->options.parameter);
        CycleFileHead head = cycle_file_head(job, {});
        head.coordinates = series_coordinates(*job.model.system);
        const periodic::ContinuationOptions& options = job.periodic->continuation->options;
        folder.store("branch.json", branches_text(head, parameter, options.lower, options.upper, result.followed));
        folder.store("branch.csv", predicted_branch_csv(head, parameter, result));
        const StoredRun stored = read_stored_run(out);
        folder.store("branch.svg", chart_svg(branch_chart(stored), job.title, run_picture_style));
    }
    store_report(folder, call.console.error);
    call.console.out << motion_summary(result, job.title);
    return 0;
}

}  // namespace

int predict_run(const CommandCall& call) {
    const int threads = call.whole_number("threads", 0, 0);
    const auto predict = [&] {
        Progress progress(call.has("quiet"), call.console.error, call.console.error_terminal);
        progress.within("reading the run");
        const StoredRun run = read_stored_run(call.words[0]);
        const std::filesystem::path data = call.words[1];
        if (is_motion_question(run, data)) {
            progress.within({});
            return predict_motions_of(call, run, data);
        }
        PredictionJob job = prediction_job(run, data, call.value("inputs", ""), call.value("experiment", ""));
        const std::filesystem::path out = prediction_folder(call, run, data);
        const nlohmann::json document = nlohmann::json::parse(job_document(job.stored, out, versions()).dump());
        OutputFolder folder(out, document, job_text(job.stored, out, versions()), call.has("force"));
        progress.within("reading the record");
        Experiment record;
        record.series = recorded_series(job.stored, 0);
        record.inputs = by_segment(load_inputs(job.stored, job.stored.data[0]), record.series.segments);
        job.stored.model.system =
            job.stored.model.system->with_state_size(state_size(job.stored, std::span(&record, 1)));
        const std::size_t readings = record.series.size();
        record.series = covered_by_inputs(job.stored, std::move(record.series), record.inputs);
        if (record.series.size() < readings)
            progress.say(fmt::format("{} of {} readings lie before or after what the inputs cover: they are left out",
                                     readings - record.series.size(), readings));
        const auto segments = record.series.sampling == orbits::Series::Sampling::samples
                                  ? static_cast<double>(record.series.segments.size())
                                  : 0.0;
        progress.begin("predict", segments, "segments");
        const Forecast result =
            forecast(job, record, [&](std::size_t done) { progress.at(static_cast<double>(done)); });
        progress.end(fmt::format("{} readings", record.series.size()));
        folder.store("prediction.json", prediction_text(result));
        folder.store("residuals.csv", residuals_text(result.rows));
        std::ostringstream complaints;
        progress.within("report");
        store_report(folder, complaints);
        progress.within({});
        call.console.error << complaints.str();
        call.console.out << prediction_summary(result, job.stored.title);
        return 0;
    };
    return with_stored_files(call, [&] { return with_thread_limit(threads, call.console, predict); });
}

int compare_runs(const CommandCall& call) {
    return with_stored_files(call, [&] {
        Progress progress(false, call.console.error, call.console.error_terminal);
        progress.within("reading the runs");
        const StoredRun first = read_stored_run(call.words[0]);
        const StoredRun second = read_stored_run(call.words[1]);
        progress.within({});
        call.console.out << comparison_text(first, second);
        return 0;
    });
}

int write_report(const CommandCall& call) {
    return with_stored_files(call, [&] {
        Progress progress(false, call.console.error, call.console.error_terminal);
        progress.within("report");
        const StoredRun run = read_stored_run(call.words.at(0));
        const std::filesystem::path file = run.folder / "report.html";
        clear_place(file);
        write_atomically(file, report_html(run));
        progress.within({});
        call.console.out << file.string() << '\n';
        return 0;
    });
}

void store_report(OutputFolder& folder, std::ostream& complaints, const std::function<bool()>& stopped) {
    try {
        StoredRun run = read_stored_run(folder.file(""));
        run.interrupted = stopped;
        folder.store("report.html", report_html(run));
    } catch (const StoredRunRefused& error) {
        complaints << "report.html: " << error.what() << '\n';
    } catch (const nlohmann::json::exception& error) {
        complaints << "report.html: " << changed_folder(folder.file(""), error) << '\n';
    } catch (const FileUnreadable& error) {
        complaints << "report.html: " << error.what() << '\n';
    } catch (const orbits::DataError& error) {
        complaints << "report.html: " << error.what() << '\n';
    }
}

}  // namespace orbid::apps
