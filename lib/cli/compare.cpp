// SPDX-License-Identifier: Apache-2.0
#include "rayloom/stats/compare.h"
#include "rayloom/cli/command.h"
#include "rayloom/core/error.h"
#include "rayloom/core/text.h"
#include "rayloom/engine/load_image.h"
#include "rayloom/image/exr_writer.h"
#include "rayloom/image/frames.h"

#include <iostream>
#include <memory>
#include <optional>

namespace rayloom::cli
{

namespace
{

struct CompareArguments {
    std::string a, b, reference, map_file, map = "relative";
    std::vector<std::string> limits;
    bool json = false, no_flip = false;
    double pixels_per_degree = flip_pixels_per_degree;
};

/// Colour channels of `path[:layer]`, alpha and the like left out.
MemoryImage load(const std::string& text)
{
    // The same rules as right of `-i name=`.
    const InputSource source = parse_input_source("image=" + text);
    const std::vector<std::string> paths = resolve_files(source, std::nullopt).paths;
    if (paths.size() != 1)
        throw UsageError("'" + text + "' names " + std::to_string(paths.size()) +
                         " files; compare takes one at a time");
    const MemoryImage image = load_image(paths.front(), source.layer);
    const std::vector<int> colour = image.desc.colour();
    if (colour.size() != 1 && colour.size() != 3)
        throw InputError("'" + text + "' has channels " + join_names(image.desc.channels) +
                         "; name a layer with one channel or with R, G and B");
    MemoryImage picked;
    picked.desc = image.desc;
    picked.desc.channels.clear();
    picked.pixels = ImageBuffer(image.desc.data, static_cast<int>(colour.size()));
    for (std::size_t c = 0; c < colour.size(); ++c) {
        picked.desc.channels.push_back(image.desc.channels[static_cast<std::size_t>(colour[c])]);
        copy_pixels(std::as_const(image.pixels).view().channel_range(colour[c], 1),
                    picked.pixels.view().channel_range(static_cast<int>(c), 1));
    }
    return picked;
}

ErrorMap map_of(const std::string& name)
{
    if (name == "absolute") return ErrorMap::absolute;
    if (name == "flip") return ErrorMap::flip;
    if (name == "hdr-flip") return ErrorMap::hdr_flip;
    return ErrorMap::relative;
}

int compare(const CompareArguments& arguments)
{
    std::vector<ErrorLimit> limits;
    for (const std::string& text : arguments.limits) limits.push_back(parse_error_limit(text));
    ErrorOptions options;
    options.pixels_per_degree = arguments.pixels_per_degree;
    options.flip = options.hdr_flip = !arguments.no_flip;

    const MemoryImage a = load(arguments.a), b = load(arguments.b);
    std::optional<MemoryImage> reference;
    if (!arguments.reference.empty()) reference = load(arguments.reference);
    const ConstImageView pixels_a = a.pixels.view(), pixels_b = b.pixels.view();
    const Comparison result =
        reference
            ? compare_images(pixels_a, pixels_b, std::as_const(reference->pixels).view(), options)
            : compare_images(pixels_a, pixels_b, options);
    std::cout << (arguments.json ? result.json() + "\n" : result.text());
    if (!arguments.map_file.empty()) {
        const ErrorPicture picture =
            error_picture(pixels_a, reference ? std::as_const(reference->pixels).view() : pixels_b,
                          map_of(arguments.map), options);
        MemoryImage out;
        out.desc.data = out.desc.display = picture.srgb.region();
        out.desc.channels = {"R", "G", "B"};
        WriteOptions write;
        write.path = arguments.map_file;
        ImageWriter writer(out.desc, write);
        writer.write(picture.srgb.view());
        writer.commit();
        std::cerr << "wrote " << arguments.map_file << " (brightest: " << picture.high << ")\n";
    }
    const std::vector<std::string> broken = broken_limits(result.a, limits);
    for (const std::string& line : broken) std::cerr << "rayloom: " << line << "\n";
    return broken.empty() ? 0 : 1;
}

} // namespace

void add_compare(CLI::App& app, Action& action)
{
    CLI::App* command = app.add_subcommand(
        "compare", "Measure image A against image B, or A and B against a reference");
    auto arguments = std::make_shared<CompareArguments>();
    command->add_option("a", arguments->a, "Image as path[:layer]")->required()->type_name("A");
    command->add_option("b", arguments->b, "Image as path[:layer]")->required()->type_name("B");
    command->add_option("--ref", arguments->reference, "Reference as path[:layer]")->type_name("R");
    command->add_flag("--json", arguments->json, "Print JSON");
    command->add_option("--map", arguments->map_file, "Write an error map (of A) here")
        ->type_name("FILE.png");
    command->add_option("--map-kind", arguments->map, "Which error the map shows")
        ->check(CLI::IsMember({"absolute", "relative", "flip", "hdr-flip"}))
        ->capture_default_str();
    command
        ->add_option(
            "--fail", arguments->limits,
            "Exit with 1 unless A keeps this limit, e.g. relmse=0.01 or psnr=40 (repeatable)")
        ->type_name("MEASURE=LIMIT")
        ->take_all()
        ->allow_extra_args(false);
    command->add_option("--ppd", arguments->pixels_per_degree, "Pixels per degree of FLIP")
        ->check(CLI::PositiveNumber)
        ->capture_default_str();
    command->add_flag("--no-flip", arguments->no_flip,
                      "Leave FLIP out (it takes most of the time)");
    command->callback(
        [arguments, &action] { action = [arguments] { return compare(*arguments); }; });
}

} // namespace rayloom::cli
