#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include <fmt/format.h>

#include "apps/job/data_job.hpp"
#include "apps/job/estimate_job.hpp"
#include "apps/job/reading/job_reader.hpp"
#include "apps/job/writing/job_writer.hpp"
#include "tests/catch.hpp"
#include "tests/source_folder.hpp"

namespace orbid::tests {

/// Where the jobs of tests are thought to lie: file paths in them are relative to it.
inline const std::filesystem::path job_folder = orbid::tests::source_folder() + "/configs";

/// Everything that is wrong with the text of a job: "job.json:7: /data/name: ...". What is printed has the column too,
/// which job_corpus_test.cpp compares.
inline std::vector<std::string> problems(const std::string& text, const std::filesystem::path& folder = job_folder) {
    std::vector<std::string> result;
    for (const apps::Problem& problem : apps::read_job(text, folder / "job.json").problems)
        result.push_back(fmt::format("job.json:{}: {}{}{}", problem.place.line, problem.pointer,
                                     problem.pointer.empty() ? "" : ": ", problem.rule));
    return result;
}

/// One thing is wrong with the job, and the message holds `expected`.
inline void check_only(const std::string& text, const std::string& expected) {
    const auto found = problems(text);
    CAPTURE(text, found);
    REQUIRE(found.size() == 1);
    CHECK_THAT(found[0], ContainsSubstring(expected));
}

/// The table of the first record of a job that is right and the same when it is written and read again.
inline apps::FileJob file_of(const std::string& text) {
    const auto reading = apps::read_job(text, job_folder / "job.json");
    REQUIRE(reading.job);
    const std::string complete = apps::job_text(*reading.job, job_folder);
    const auto again = apps::read_job(complete, job_folder / "job.json");
    REQUIRE(again.job);
    CHECK(apps::job_text(*again.job, job_folder) == complete);
    return *again.job->data[0].file;
}

}  // namespace orbid::tests
