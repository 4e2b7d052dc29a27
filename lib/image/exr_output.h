// SPDX-License-Identifier: Apache-2.0
/// \file
/// What the writers of flat and deep EXR share: names, types, headers. Not for use outside the
/// library: it includes OpenEXR.
#pragma once

#include "rayloom/image/atomic_file.h"
#include "rayloom/image/image_desc.h"

#include <OpenEXR/ImfCompression.h>
#include <OpenEXR/ImfIO.h>
#include <OpenImageIO/imageio.h>

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace rayloom
{

/// Lets OpenEXR write into an AtomicFile.
class AtomicStream final : public Imf::OStream
{
public:
    explicit AtomicStream(AtomicFile& file) : OStream(file.path().c_str()), m_file(&file) {}
    void write(const char c[], int n) override { m_file->write(c, static_cast<std::size_t>(n)); }
    uint64_t tellp() override { return m_file->tell(); }
    void seekp(uint64_t position) override { m_file->seek(position); }

private:
    AtomicFile* m_file;
};

/// Whether the file's ending says that it is an EXR.
bool is_exr(const std::string& path);

/// A pixel type as users name it. Throws NodeError that names the file for an unknown one.
OIIO::TypeDesc parse_type(const std::string& path, const std::string& type);

/// The type a channel had in the file the image came from.
std::optional<OIIO::TypeDesc> source_type(const ImageDesc& desc, const std::string& channel);

/// Half or float: `type` when it is not empty, else as the channel's source had it, else half for
/// colour and float for data. May be a type no EXR has when the user asks for one.
OIIO::TypeDesc exr_type(const ImageDesc& desc, const std::string& channel, const std::string& path,
                        const std::string& type);

struct ExrCompression {
    Imf::Compression method = Imf::ZIP_COMPRESSION;
    std::optional<float> level; ///< of zip and zips (1 to 9), of dwaa and dwab (more loses more)
};

/// A compression by the name users know it by ("dwaa:45"). Throws NodeError for an unknown name, or
/// a level that it does not have.
ExrCompression compression_named(const std::string& path, const std::string& compression);

/// The names of channels under a layer, which may be empty. Throws NodeError where an EXR would not
/// hold them: names of more than 255 bytes, which OpenEXR cuts, or the same name twice.
std::vector<std::string> full_names(const std::string& path, const std::string& layer,
                                    const std::vector<std::string>& channels);

/// The image's header without what speaks of the file it came from, with its windows and without
/// channels.
OIIO::ImageSpec header_without_channels(const ImageDesc& desc);

/// Drops manifests of cryptomattes whose layers `spec` does not have.
void drop_orphaned_manifests(OIIO::ImageSpec& spec);

} // namespace rayloom
