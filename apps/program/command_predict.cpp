#include <filesystem>
#include <ostream>

#include "apps/job/version.hpp"
#include "apps/job/writing/job_writer.hpp"
#include "apps/program/command_stored.hpp"
#include "apps/program/thread_limit.hpp"
#include "apps/results/output_folder.hpp"
#include "apps/stored_run/forecast.hpp"
#include "apps/stored_run/prediction_job.hpp"
#include "apps/stored_run/prediction_results.hpp"

namespace orbid::apps {

int predict_run(const CommandCall& call) {
    const int threads = call.whole_number("threads", 0, 0);
    const auto predict = [&] {
        const StoredRun run = read_stored_run(call.words[0]);
        const std::filesystem::path data = call.words[1];
        const PredictionJob job = prediction_job(run, data, call.value("experiment", ""));
        const std::filesystem::path out =
            call.value("out", (run.folder / ("predict_" + data.stem().string())).string());
        const nlohmann::json document = nlohmann::json::parse(job_document(job.stored, out, versions()).dump());
        OutputFolder folder(out, document, job_text(job.stored, out, versions()), call.has("force"));
        Experiment record;
        record.series = recorded_series(job.stored, 0);
        record.inputs = by_segment(load_inputs(job.stored, job.stored.data[0]), record.series.segments.size());
        const Forecast result = forecast(job, record);
        folder.store("prediction.json", prediction_text(result));
        folder.store("residuals.csv", residuals_text(result.rows));
        call.console.out << prediction_summary(result, job.stored.title);
        return 0;
    };
    return with_stored_files(call, [&] { return with_thread_limit(threads, call.console, predict); });
}

}  // namespace orbid::apps
